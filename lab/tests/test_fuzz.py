"""Tests of readers against mutated inputs, and of the program that finds them."""

import random

import numpy as np
import pytest

from eskin.skin import build_grid_skin, skin_from_bytes, skin_to_bytes
from lab.fuzz.decoder import DecoderTarget
from lab.fuzz.models import ModelTarget
from lab.fuzz.recordings import RecordingTarget
from lab.fuzz.robots import CommandsTarget, RobotTarget
from lab.fuzz.run import HangError, Target, fuzz, where
from lab.fuzz.skin_files import SkinTarget


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


@pytest.mark.parametrize("end", [b"\r\n", b"\r"])
def test_table_may_have_any_line_ends(end):
    skin = build_grid_skin(2, 3, name="small")
    head, mark, table = skin_to_bytes(skin).partition(b"...\n")
    read = skin_from_bytes(head + mark + table.replace(b"\n", end))
    np.testing.assert_array_equal(read.positions, skin.positions)
