import numpy as np
import pytest

from eskin.touch import Calibrator, FaultDetector
from helpers.touch import SECOND, START, build_grid_skin, calibration_of, scan_at

SKIN = build_grid_skin(rows=6, columns=6, patches=2)
COUNT = SKIN.count
SICK = 7 + 36
PLACE = ("p1", 1, 1, SICK)


def place_of(fault):
    return fault.patch, fault.row, fault.column, fault.taxel


def play(plant, seconds=12.0, rate=50, noise=2.0, rest=200):
    """Push noisy counts at rest, changed by `plant`; return what was said."""
    rng = np.random.default_rng(3)
    calibration = calibration_of(SKIN)
    calibrator = Calibrator(SKIN, calibration)
    finder = FaultDetector(SKIN, calibration)
    said = []
    for t in np.arange(round(seconds * rate)) / rate:
        counts = np.round(rest + noise * rng.standard_normal(COUNT)).astype(np.int32)
        received = np.ones(COUNT, bool)
        plant(t, counts, received)
        scan = scan_at(t, np.clip(counts, -1, 1000), received)
        reading = calibrator.push(scan)
        mask, faults = finder.push(scan, reading.pressure)
        said.append((t, mask.copy(), faults))
    return said


def never(t, counts, received):
    pass


def test_a_sound_skin_has_no_faults():
    assert not any(faults or mask.any() for _, mask, faults in play(never))


@pytest.mark.parametrize("rest", [0, 5])
def test_a_quiet_quantised_skin_is_sound(rest):
    said = play(never, seconds=30.0, noise=0.0, rest=rest)
    assert not any(faults for _, _, faults in said)


def test_zeros_at_rest_are_sound_where_rest_is_about_zero():
    def clip(t, counts, received):
        np.maximum(counts, 0, out=counts)

    said = play(clip, seconds=30.0, noise=3.0, rest=-2)
    assert not any(faults for _, _, faults in said)


def test_a_long_touch_into_saturation_is_sound():
    def touch(t, counts, received):
        if 3.0 <= t < 40.0:
            counts[:12] = 1000

    said = play(touch, seconds=45.0, rate=20)
    assert not any(faults for _, _, faults in said)


@pytest.mark.parametrize(
    ("kind", "value", "within"),
    [("stuck", 300, 5.5), ("dead", 0, 5.5), ("negative", -1, 0.2)],
)
def test_a_planted_fault_is_found_where_it_is_and_since_when(kind, value, within):
    def plant(t, counts, received):
        if t >= 3.0:
            counts[SICK] = value

    said = play(plant)
    last_mask, last_faults = said[-1][1:]
    assert [fault.kind for fault in last_faults] == [kind]
    assert place_of(last_faults[0]) == PLACE
    assert last_faults[0].since == START + 3 * SECOND
    assert np.flatnonzero(last_mask).tolist() == [SICK]
    first = next(t for t, _, faults in said if faults)
    assert 3.0 <= first < 3.0 + within


def test_full_scale_since_the_start_is_saturation():
    def plant(t, counts, received):
        counts[SICK] = 1000

    said = play(plant)
    assert [(f.kind, place_of(f)) for f in said[-1][2]] == [("saturated", PLACE)]


def test_full_scale_for_longer_than_any_touch_is_saturation():
    def plant(t, counts, received):
        if t >= 3.0:
            counts[SICK] = 1000

    said = play(plant, seconds=66.0, rate=10)
    first = next(t for t, _, faults in said if faults)
    assert first == pytest.approx(63.0, abs=0.3)
    assert [(f.kind, place_of(f)) for f in said[-1][2]] == [("saturated", PLACE)]


def test_negative_counts_are_masked_at_once():
    def plant(t, counts, received):
        if t >= 3.01:
            counts[SICK] = -1

    for t, mask, _ in play(plant, seconds=4.0):
        assert mask[SICK] == (t >= 3.01)


def test_a_quiet_taxel_that_ignores_presses_around_it_is_dead():
    around = np.linalg.norm(SKIN.positions - SKIN.positions[SICK], axis=1) < 0.03

    def plant(t, counts, received):
        if t % 4.0 > 2.0:
            counts[around] += 300
        counts[SICK] = 0

    said = play(plant, noise=0.0, rest=0, seconds=9.0)
    assert [(f.kind, place_of(f)) for f in said[-1][2]] == [("dead", PLACE)]


def test_a_taxel_at_the_rim_of_a_steady_press_is_sound():
    def plant(t, counts, received):
        if t > 2.0:
            counts[SKIN.columns < 3] += 300

    said = play(plant, noise=0.0, rest=5, seconds=20.0)
    assert not any(faults for _, _, faults in said)


@pytest.mark.parametrize(
    ("kind", "row", "column"), [("row", 2, None), ("column", None, 4)]
)
def test_a_row_or_column_out_is_one_fault(kind, row, column):
    line = SKIN.rows == row if column is None else SKIN.columns == column
    line = line & (SKIN.patch_index == 1)

    def plant(t, counts, received):
        if t >= 3.0:
            counts[line] = 0

    said = play(plant, seconds=5.0)
    found = [(f.kind, f.patch, f.row, f.column, f.taxel) for f in said[-1][2]]
    assert found == [(kind, "p1", row, column, None)]
    assert np.array_equal(said[-1][1], line)
    assert next(t for t, _, faults in said if faults) < 4.0


def test_a_stuck_row_is_one_fault():
    line = (SKIN.rows == 5) & (SKIN.patch_index == 0)

    def plant(t, counts, received):
        if t >= 3.0:
            counts[line] = 250 + np.arange(line.sum())

    faults = play(plant)[-1][2]
    assert [(f.kind, f.patch, f.row) for f in faults] == [("row", "p0", 5)]


def test_a_silent_patch_is_one_fault():
    def plant(t, counts, received):
        received[36:] = t < 3.0

    said = play(plant, seconds=5.0)
    assert [(f.kind, f.patch, f.row) for f in said[-1][2]] == [("patch", "p1", None)]
    assert said[-1][2][0].since == START + round(2.98 * SECOND)


@pytest.mark.parametrize("value", [300, 0, -1])
def test_a_fault_that_is_gone_is_believed_after_a_while_but_not_at_once(value):
    def plant(t, counts, received):
        if 3.0 <= t < 12.0:
            counts[SICK] = value

    said = play(plant, seconds=15.0)
    faulty = np.array([mask[SICK] for _, mask, _ in said])
    times = np.array([t for t, _, _ in said])
    assert faulty[(times > 11.0) & (times < 12.5)].all()
    assert not faulty[times > 14.0].any()
    assert not said[-1][2]


def test_faults_do_not_depend_on_the_rate():
    def plant(t, counts, received):
        counts[SICK] = 300 if t >= 3.0 else counts[SICK]
        counts[:6] = -1

    slow = play(plant, rate=10)[-1][2]
    fast = play(plant, rate=200)[-1][2]
    assert [(f.kind, place_of(f)) for f in slow] == [
        (f.kind, place_of(f)) for f in fast
    ]


def test_a_taxel_that_jumps_on_its_own_is_noisy_until_it_stops():
    rng = np.random.default_rng(5)

    def plant(t, counts, received):
        if 3.0 <= t < 12.0:
            counts[SICK] += round(80 * rng.standard_normal())

    said = play(plant, seconds=18.0)
    [fault] = next(faults for t, _, faults in said if t >= 11.9)
    assert (fault.kind, place_of(fault)) == ("noisy", PLACE)
    assert 0 <= fault.since - (START + 3 * SECOND) < 2 * SECOND
    assert not said[-1][2]
    assert not any(faults for t, _, faults in said if t < 6.0)


def test_a_hand_that_shakes_is_no_noise():
    """Its whole place shakes with it, and slower than a sensor's noise."""
    place = [i for i in range(36) if SKIN.rows[i] < 4 and SKIN.columns[i] < 4]

    def shake(t, counts, received):
        if t >= 3.0:
            counts[place] += round(300 + 80 * np.sin(2 * np.pi * 9.0 * t))

    assert not any(faults for _, _, faults in play(shake, seconds=15.0))


def test_a_finger_that_rubs_over_a_taxel_is_no_noise():
    def rub(t, counts, received):
        if t >= 3.0:
            counts[SICK] += round(150 + 150 * np.sin(2 * np.pi * 3.0 * t))

    assert not any(faults for _, _, faults in play(rub, seconds=15.0))
