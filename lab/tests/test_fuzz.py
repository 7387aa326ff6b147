"""Tests of readers against mutated inputs, and of the program that finds them."""

import random

import numpy as np
import pytest

from eskin.errors import SkinError
from eskin.skin import build_grid_skin, load_skin, skin_from_bytes, skin_to_bytes
from lab.fuzz.decoder import DecoderTarget
from lab.fuzz.models import ModelTarget
from lab.fuzz.recordings import RecordingTarget
from lab.fuzz.robots import CommandsTarget, RobotTarget
from lab.fuzz.run import HangError, Target, fuzz, where
from lab.fuzz.skin_files import BETWEEN, SkinTarget


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "inputs"),
    [
        (DecoderTarget, 1000),
        (SkinTarget, 40),
        (RecordingTarget, 40),
        (CommandsTarget, 200),
        (ModelTarget, 40),
        (RobotTarget, 40),
    ],
)
def test_no_mutated_input_breaks_a_reader(kind, inputs, tmp_path):
    outcome = fuzz(kind(tmp_path), first=10**9, inputs=inputs, seed=0)
    assert not outcome.findings
    assert outcome.accepted < outcome.inputs == inputs


def test_seed_makes_the_same_input_again(tmp_path):
    one = DecoderTarget(tmp_path)
    other = DecoderTarget(tmp_path)
    assert one.make(random.Random(7)) == other.make(random.Random(7))


class BrokenTarget(Target):
    def __init__(self, folder):
        pass

    def make(self, rng):
        return rng.randbytes(4)

    def feed(self, data):
        raise HangError("stuck") if data[0] < 128 else KeyError(data)


def test_finding_is_counted_once_and_names_its_first_input(tmp_path):
    findings = fuzz(BrokenTarget(tmp_path), first=0, inputs=40, seed=0).findings
    assert len(findings) == 2
    assert all(first.startswith("input ") for first in findings.values())
    assert where(KeyError()).startswith("KeyError")


@pytest.mark.parametrize(
    ("old", "new", "part"),
    [
        (b"name: small", b"name: !!bool 1", "line 2, column 7"),
        (b"name: small", b"name: !!int ''", "''"),
        (b"name: small", b"name: !!timestamp a", "'a'"),
        (b"name: small", b"name: !!float a", "'a'"),
        (b"name: small", b"name: 2001-99-99", "'2001-99-99'"),
        (b"name: small", b"name: " + b"9" * 5000, "int"),
        (b"name: small", b"? [a]\n: b\nname: small", "key"),
        (b"name: small", b"? {a: b}\n: b\nname: small", "key"),
        (b"name: small", b'"a\\nb": 1\nname: small', r"'a\nb'"),
        (b"name: small", b'name: "a\\vb"', r"name: got 'a\x0bb'"),
        (b"name: small", b'name: "a\\u2028b"', r"name: got 'a\u2028b'"),
        (b"name: small", b'name: "\\U99999999"', "YAML"),
        (b"name: small", b'name: "\\UFFFFFFFF"', "YAML"),
        (b"name: small", b'name: "\\ud800"', "name: got"),
        (b"name: small", b'"\\ud800": 1', "skin.yaml: "),
        (b"name: small", b"%YAML " + b"9" * 5000 + b".1\n---\nname: small", "YAML"),
        (b"name: small", b"name: " + b"[" * 100_000, "20 nested collections"),
        (b"name: small", b"name: !!python/object/apply:os.getcwd []", "YAML"),
        (b",100,", b",1e999999999,", "area_mm2: got '1e999999999'"),
        (b",100,", b",sNaN,", "area_mm2: got 'sNaN'"),
        (b",1.0,100", b",1e200,100", "normal has length inf"),
        (b"0,grid", "0,gr\x0bid\u2028".encode(), "taxel 0"),
        (b"0,grid", b'0,"' + b"a" * 140_000, "field"),
    ],
    ids=lambda value: ascii(value)[:30],
)
def test_wild_skin_is_refused_in_one_line(tmp_path, old, new, part):
    target = SkinTarget(tmp_path)
    data = (target.manifest + BETWEEN + target.table).replace(old, new, 1)
    manifest, _, table = data.partition(BETWEEN)
    (tmp_path / "skin.yaml").write_bytes(manifest)
    (tmp_path / "taxels.csv").write_bytes(table)
    with pytest.raises(SkinError) as in_text:
        skin_from_bytes(data)
    with pytest.raises(SkinError) as in_folder:
        load_skin(tmp_path)
    for caught in (in_text, in_folder):
        assert len(str(caught.value).splitlines()) == 1
    assert part in str(in_folder.value)


@pytest.mark.parametrize("end", [b"\r\n", b"\r"])
def test_table_may_have_any_line_ends(end):
    skin = build_grid_skin(2, 3, name="small")
    head, mark, table = skin_to_bytes(skin).partition(b"...\n")
    read = skin_from_bytes(head + mark + table.replace(b"\n", end))
    np.testing.assert_array_equal(read.positions, skin.positions)
