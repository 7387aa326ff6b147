"""Tests of files written before the packages were moved: they open, and say the same.

`tests/data/before/README.txt` tells how they were made.
"""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from eskin import (
    Calibration,
    Recognizer,
    SourceConfig,
    load_model,
    open_source,
    read_recording,
)
from eskin.command import Rule, load_commands, parse_commands
from eskin.errors import CommandError

pytestmark = pytest.mark.slow

BEFORE = Path(__file__).parent / "data" / "before"
RECORDING = BEFORE / "recording.mcap"
MODEL = BEFORE / "model.safetensors"
CALIBRATION = BEFORE / "calibration.json"
COMMANDS = BEFORE / "commands.yaml"
ANSWERS = BEFORE / "answers.json"


def read_scans():
    """Return what the recording holds besides detections."""
    recording = read_recording(RECORDING)
    arrays = recording.arrays()
    skin = recording.skin
    return {
        "skin": [skin.name, skin.count, *(patch.id for patch in skin.patches)],
        "robot": [recording.robot_name, *recording.joint_names],
        "labels": [[label.gesture, label.source] for label in recording.labels],
        "detections": [found.gesture for found in recording.detections],
        "truths": len(list(recording.truths())),
        "scans": recording.count,
        "counts": [int(n) for n in arrays.counts.sum(axis=0)],
        "q": [float(angle) for angle in arrays.q.mean(axis=0)],
    }


def recognise(calibration=None):
    """Return what the model finds in the recording, however unlikely."""
    config = SourceConfig(calibration=calibration, pace=np.inf)
    with open_source(f"replay:{RECORDING}", config=config) as source:
        info = source.info
        loaded = load_model(MODEL)
        settings = {
            "threshold": 0.3,
            "thresholds": {},
            "brief_seconds": 0.0,
            "least": 0,
        }
        decision = replace(loaded.card.decision, **settings)
        recognizer = Recognizer(loaded, info.mounted, info.calibration, decision)
        scans = list(source)
    found = [one for scan in scans for one in recognizer.push(scan)]
    return [describe(one, scans[0].stamp) for one in found + recognizer.finish()]


def describe(found, start):
    """Return a detection as plain values, its times since the start [ms]."""
    stamps = found.stamp, found.onset, found.end
    vectors = found.p_world, found.n_world, found.direction_world
    return {
        "names": [found.gesture, found.link, found.patch, found.heading],
        "times": [round((stamp - start) / 1e6) for stamp in stamps],
        "vectors": [vector.tolist() for vector in vectors],
        "numbers": [found.confidence, found.peak_force],
    }


def read_calibration():
    """Return the constants of the calibration file, and pressures by its curve."""
    calibration = Calibration.from_bytes(CALIBRATION.read_bytes())
    constants = json.loads(calibration.to_bytes())
    above = np.outer([10.0, 100.0, 1000.0], np.ones(len(calibration.gain)))
    pressure = calibration.compute_pressure(above)
    return {"constants": constants, "pressures": pressure.mean(axis=1).tolist()}


def read_rules():
    """Return the rules of the command map."""
    commands = parse_commands(COMMANDS.read_text("utf-8"), COMMANDS.name)
    return [rule.model_dump(exclude_none=True) for rule in commands.commands]


READERS = {
    "recording": read_scans,
    "model": recognise,
    "calibration": read_calibration,
    "detections by calibration": lambda: recognise(CALIBRATION),
    "commands": read_rules,
}


def flatten(value, path=""):
    """Yield every plain value of nested lists and dictionaries with its path."""
    if not isinstance(value, dict | list):
        yield path, value
        return
    for key, one in value.items() if isinstance(value, dict) else enumerate(value):
        yield from flatten(one, f"{path}/{key}")


@pytest.mark.parametrize("name", READERS)
def test_file_of_before_gives_same_answer(name):
    kept = dict(flatten(json.loads(ANSWERS.read_text("utf-8"))[name]))
    found = dict(flatten(json.loads(json.dumps(READERS[name]()))))
    for path, value in kept.items():
        if isinstance(value, float):
            kept[path] = pytest.approx(value, rel=1e-4, abs=1e-6)
    assert found == kept


def test_map_of_before_by_which_things_start_the_arm_is_refused_with_a_remedy():
    recording = read_recording(RECORDING)
    vocabulary = load_model(MODEL).card.vocabulary
    with pytest.raises(CommandError, match=r"commands\[1\].*'gesture: grab'"):
        load_commands(COMMANDS, vocabulary, recording.skin)


def test_every_key_of_a_rule_is_in_the_map():
    assert {key for rule in read_rules() for key in rule} == set(Rule.model_fields)


if __name__ == "__main__":
    answers = {name: reader() for name, reader in READERS.items()}
    ANSWERS.write_text(json.dumps(answers, indent=1) + "\n", "utf-8")
