"""Fuzzing finds what it should, and the readers refuse what they cannot read."""

import random

import numpy as np
import pytest
from benchmarks.fuzz.command_maps import CommandsTarget
from benchmarks.fuzz.decoder import DecoderTarget
from benchmarks.fuzz.recordings import RecordingTarget
from benchmarks.fuzz.run import HangError, fuzz, where
from benchmarks.fuzz.skin_files import BETWEEN, SkinTarget
from benchmarks.fuzz.target import Target

from eskin.errors import SkinError
from eskin.skin import build_grid_skin, load_skin, skin_from_bytes, skin_to_bytes


@pytest.mark.parametrize(
    ("kind", "inputs"),
    [
        (DecoderTarget, 2000),
        (SkinTarget, 60),
        (RecordingTarget, 40),
        (CommandsTarget, 200),
    ],
)
def test_no_mutated_input_breaks_a_reader(kind, inputs, tmp_path):
    outcome = fuzz(kind(tmp_path), first=10**9, inputs=inputs, seed=0)
    assert not outcome.findings
    assert outcome.accepted < outcome.inputs == inputs


def test_an_input_can_be_made_again_from_its_number(tmp_path):
    one, other = DecoderTarget(tmp_path), DecoderTarget(tmp_path)
    assert one.make(random.Random(7)) == other.make(random.Random(7))


class Broken(Target):
    def __init__(self, folder):
        pass

    def make(self, rng):
        return rng.randbytes(4)

    def feed(self, data):
        raise HangError("stuck") if data[0] < 128 else KeyError(data)


def test_a_finding_is_counted_once_and_names_its_first_input(tmp_path):
    findings = fuzz(Broken(tmp_path), first=0, inputs=40, seed=0).findings
    assert len(findings) == 2
    assert all(first.startswith("input ") for first in findings.values())
    assert where(KeyError()).startswith("KeyError")


def skin_refusal(folder, old, new):
    """How a skin is refused, from its folder and from one text."""
    skins = SkinTarget(folder)
    data = (skins.manifest + BETWEEN + skins.table).replace(old, new, 1)
    with pytest.raises(SkinError) as in_text:
        skin_from_bytes(data)
    manifest, _, table = data.partition(BETWEEN)
    (folder / "skin.yaml").write_bytes(manifest)
    (folder / "taxels.csv").write_bytes(table)
    with pytest.raises(SkinError) as in_folder:
        load_skin(folder)
    for caught in (in_text, in_folder):
        assert len(str(caught.value).splitlines()) == 1
    return str(in_folder.value)


@pytest.mark.parametrize(
    ("new", "said"),
    [
        (b"name: !!bool 1", "skin.yaml line 2, column 7: not plain YAML: '1' is no b"),
        (b"name: !!int ''", "'' is no int"),
        (b"name: !!timestamp a", "'a' is no timestamp"),
        (b"name: !!float a", "'a' is no float"),
        (b"name: 2001-99-99", "'2001-99-99' is no timestamp"),
        (b"name: " + b"9" * 5000, "is no int"),
        (b"? [a]\n: b\nname: small", "a key is not a word"),
        (b"? {a: b}\n: b\nname: small", "a key is not a word"),
        (b'"a\\nb": 1\nname: small', r"'a\nb' is not known"),
        (b'name: "a\\vb"', r"name: got 'a\x0bb', allowed one line"),
        (b'name: "\\U99999999"', "not plain YAML"),
        (b'name: "\\UFFFFFFFF"', "not plain YAML"),
        (b'name: "\\ud800"', "name: got"),
        (b'"\\ud800": 1', "skin.yaml: "),
        (b"%YAML " + b"9" * 5000 + b".1\n---\nname: small", "not plain YAML"),
        (b"name: " + b"[" * 100_000, "more than 20 collections lie in each other"),
        (b'name: "a\\u2028b"', r"name: got 'a\u2028b', allowed one line"),
        (b"name: !!python/object/apply:os.getcwd []", "not plain YAML"),
    ],
)
def test_yaml_that_is_not_plain_is_refused_in_one_line(tmp_path, new, said):
    assert said in skin_refusal(tmp_path, b"name: small", new)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        (b",100,", b",1e999999999,", "column area_mm2: got '1e999999999', allowed a"),
        (b",100,", b",sNaN,", "column area_mm2: got 'sNaN', allowed a finite number"),
        (b",1.0,100", b",1e200,100", "normal has length inf, allowed 1 +- 0.001"),
        (b"0,grid", "0,gr\x0bid\u2028".encode(), "patch 'gr id', taxel 0:"),
        (b"0,grid", b'0,"' + b"a" * 140_000, "field larger than field limit"),
    ],
)
def test_a_table_that_is_wild_is_refused_in_one_line(tmp_path, old, new, said):
    assert said in skin_refusal(tmp_path, old, new)


def test_a_table_reads_alike_whatever_ends_its_lines():
    skin = build_grid_skin(2, 3, name="small")
    head, mark, table = skin_to_bytes(skin).partition(b"...\n")
    for end in (b"\r\n", b"\r"):
        read = skin_from_bytes(head + mark + table.replace(b"\n", end))
        np.testing.assert_array_equal(read.positions, skin.positions)
