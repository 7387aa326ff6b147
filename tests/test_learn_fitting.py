"""A sequence is of the true touch that most of its force lies near."""

import numpy as np
import pytest

from eskin.learn.ground_truth import (
    MAX_DISTANCE,
    TouchLabel,
    TrueTouches,
    read_true_touches,
)
from eskin.recording import (
    Metadata,
    RecordingWriter,
    TruthRecord,
    read_recording,
)
from eskin.skin import build_grid_skin
from eskin.touch import Calibration, Scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
STEP = SECOND // 50
LEFT, RIGHT = np.array([-0.15, 0.0, 0.0]), np.array([0.15, 0.0, 0.0])
NAMES = {7: TouchLabel(7, "poke", "tip"), 3: TouchLabel(3, "rub", "palm")}


def truth(touches=((7, LEFT), (3, RIGHT)), readings=5) -> TrueTouches:
    """Some touches, each at one place, at the first readings."""
    rows = [(START + STEP * n, *touch) for n in range(readings) for touch in touches]
    return TrueTouches(
        stamps=np.array([row[0] for row in rows]),
        touch=np.array([row[1] for row in rows]),
        p_world=np.array([row[2] for row in rows]),
        labels=NAMES,
    )


def fit(known, centres, forces=None, first=0):
    """The fit of a sequence of contacts, 20 ms apart."""
    centres = np.array(centres)
    stamps = START + STEP * (first + np.arange(len(centres)))
    forces = np.ones(len(centres)) if forces is None else np.array(forces, float)
    return known.identify(stamps, centres, forces)


@pytest.mark.parametrize(("place", "number"), [(LEFT, 7), (RIGHT, 3)])
def test_a_sequence_is_of_the_nearest_true_touch(place, number):
    beside = np.array([0.0, 0.02, 0.01])
    assert fit(truth(), [place + beside] * 4) == NAMES[number]


def test_of_two_touches_within_reach_it_is_the_nearer():
    known = truth(((7, LEFT), (3, LEFT + [0.06, 0, 0])))
    assert fit(known, [LEFT + [0.02, 0, 0]] * 3) == NAMES[7]
    assert fit(known, [LEFT + [0.04, 0, 0]] * 3) == NAMES[3]


def test_force_decides_not_the_number_of_readings():
    centres = [LEFT, LEFT, LEFT, RIGHT]
    assert fit(truth(), centres, [1, 1, 1, 4]) == NAMES[3]
    assert fit(truth(), centres, [1, 1, 1, 2]) == NAMES[7]


def test_between_equals_it_is_the_touch_that_came_first():
    assert fit(truth(), [RIGHT, LEFT]) == fit(truth(), [LEFT, RIGHT]) == NAMES[3]


def test_a_contact_near_no_true_touch_is_a_ghost():
    for reach, found in ((0.99 * MAX_DISTANCE, NAMES[7]), (1.01 * MAX_DISTANCE, None)):
        assert fit(truth(), [LEFT + [0, 0, reach]] * 4) == found


def test_a_contact_after_all_true_touches_is_a_ghost():
    known = truth(readings=5)
    assert fit(known, [LEFT] * 3, first=4) == NAMES[7]
    assert fit(known, [LEFT] * 3, first=5) is None


def test_readings_without_contact_say_nothing():
    nowhere = np.full(3, np.nan)
    assert fit(truth(), [nowhere, RIGHT, nowhere], [0, 1, 0]) == NAMES[3]
    assert fit(truth(), [nowhere] * 3, [0, 0, 0]) is None


def recorded(path, records, simulated=True):
    """A recording of one scan and what was truly done."""
    skin = build_grid_skin(2, 2)
    notes = {"simulated": "true"} if simulated else {}
    calibration = Calibration.uniform(skin.count, 4095, 100.0)
    metadata = Metadata("scene", notes=notes)
    with RecordingWriter(path, "table", skin, calibration, metadata) as writer:
        counts = np.zeros(skin.count, np.int32)
        writer.write(Scan(START, counts, np.ones(skin.count, bool), np.zeros(0)))
        for record in records:
            writer.write_truth(record)
    return read_recording(path)


def record(n, number, place) -> TruthRecord:
    facts = NAMES[number]
    x, y, z = place
    stamp = START + STEP * n
    return TruthRecord(stamp, number, *facts[1:], "table", 1.0, 1e-4, (x, y, z))


def test_the_truth_of_a_recording_does_not_depend_on_its_order(tmp_path):
    # As written second by second: all of one touch, then all of the other.
    records = [record(n, 7, LEFT) for n in range(4)]
    records += [record(n, 3, RIGHT) for n in range(4)]
    found = read_true_touches(recorded(tmp_path / "a.mcap", records))
    assert found is not None
    assert found.labels == NAMES
    assert (np.diff(found.stamps) >= 0).all()
    for place, number in ((LEFT, 7), (RIGHT, 3)):
        assert fit(found, [place] * 4) == NAMES[number]


def test_a_simulated_recording_without_touches_has_only_ghosts(tmp_path):
    found = read_true_touches(recorded(tmp_path / "a.mcap", []))
    assert found is not None
    assert fit(found, [LEFT] * 2) is None


def test_of_a_real_recording_the_truth_is_not_known(tmp_path):
    assert read_true_touches(recorded(tmp_path / "a.mcap", [], simulated=False)) is None
