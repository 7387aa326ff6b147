"""Tests of faults: a planted fault is found and named, and a sound skin has none."""

import numpy as np
import pytest

from eskin.touch import Calibration, FrontEnd
from helpers.touch import SECOND, START, build_grid_skin, calibration_of, scan_at

SKIN = build_grid_skin(patches=2)
TAXEL = 7 + 36
PLACE = ("p1", 1, 1, TAXEL)
PALM = (SKIN.patch_index == 0) & (SKIN.rows < 4) & (SKIN.columns < 4)
AROUND = np.linalg.norm(SKIN.positions - SKIN.positions[TAXEL], axis=1) < 0.03


def push_counts(change, seconds=12.0, rate=50, noise=2.0, rest=200, scale=100.0):
    """Push noisy counts at rest, changed by `change`; yield time and detector.

    A taxel measures up to `scale` [kPa] by 1000 counts.
    """
    rng = np.random.default_rng(3)
    calibration = Calibration.uniform(SKIN.count, 1000, scale)
    detector = FrontEnd(SKIN, calibration)
    for t in np.arange(round(seconds * rate)) / rate:
        counts = np.round(rest + noise * rng.standard_normal(SKIN.count)).astype(int)
        received = np.ones(SKIN.count, bool)
        change(t, counts, received)
        scan = scan_at(t, np.clip(counts, -1, 1000), received)
        detector.make_reading(scan)
        yield t, detector


def find_faults(change, *words, **options):
    """Push counts, see `push_counts`; return times, masks and faults."""
    pushed = push_counts(change, *words, **options)
    return [(t, detector.mask.copy(), detector.taxel_faults) for t, detector in pushed]


def set_counts(taxels, value, start=3.0, end=np.inf):
    """Return the change that sets counts of some taxels for a time."""

    def change(t, counts, received):
        if start <= t < end:
            counts[taxels] = value

    return change


def add_counts(taxels, signal, start=3.0):
    """Return the change that adds `signal(t)` to the counts of some taxels."""

    def change(t, counts, received):
        if t >= start:
            counts[taxels] += round(signal(t))

    return change


def cut(t, counts, received):
    """Set counts below 4 to zero, as a coarse converter does."""
    counts[counts < 4] = 0


def round_quietly(t, counts, received):
    """Give taxels rests between counts, and less noise than a converter rounds off."""
    rests = 6.0 + np.random.default_rng(9).random(len(counts))
    noise = np.random.default_rng(round(1e6 * t)).normal(0.0, 0.2, len(counts))
    counts[:] = np.round(rests + noise)


def lift_at_start(t, counts, received):
    """Let a converter that rests at zero begin above it."""
    if t < 0.3:
        counts += 60


NO_CHANGE = add_counts(TAXEL, lambda t: 0)


def tap(t):
    """Return the counts of a finger that taps one taxel twice a second."""
    return 300 * np.clip(1.5 * np.sin(4 * np.pi * t), 0, 1)


def pat(t):
    """Return the counts of a hand that pats every 0.41 s, for 0.08 s."""
    return 300 * (t % 0.41 < 0.08)


def waver(t):
    """Return the counts of a taxel that is at most two counts from rest."""
    return 2 * np.sin(70 * t)


def toggle(t):
    """Return the counts of a taxel that steps up and down every second."""
    return 40 * (t % 2 < 1)


def hum(t):
    """Return the counts of mains hum that beats with the scans twice a second."""
    return 30 * np.sin(4 * np.pi * t)


def describe(found):
    """Return kind and place of the last faults."""
    return [(f.kind, f.patch, f.row, f.column, f.taxel) for f in found[-1][2]]


def first_time(found):
    """Return the time of the first fault [s]."""
    return next(t for t, _, faults in found if faults)


@pytest.mark.parametrize(
    ("change", "options"),
    [
        (NO_CHANGE, {}),
        (NO_CHANGE, {"noise": 12.0}),
        (cut, {"noise": 4.0, "rest": 2, "seconds": 30.0}),
        (NO_CHANGE, {"noise": 0.0, "seconds": 30.0, "rate": 20}),
        (NO_CHANGE, {"noise": 0.0, "rest": 5}),
        (
            lambda t, counts, _: np.maximum(counts, 0, out=counts),
            {"noise": 3.0, "rest": -2, "seconds": 30.0, "rate": 20},
        ),
        (set_counts(np.arange(12), 1000, end=40.0), {"seconds": 45.0, "rate": 10}),
        (add_counts(SKIN.columns < 3, lambda t: 300), {"noise": 0.0, "rest": 5}),
        (add_counts(PALM, lambda t: 300 + 80 * np.sin(18 * np.pi * t)), {}),
        (add_counts(TAXEL, lambda t: 150 + 150 * np.sin(6 * np.pi * t)), {}),
        (add_counts(TAXEL, tap), {}),
        (add_counts(PALM, pat), {"noise": 1.0, "rate": 12, "seconds": 30.0}),
        (add_counts(TAXEL, waver), {"noise": 0.2, "scale": 400.0}),
        (lift_at_start, {"noise": 0.0, "rest": 0}),
        (round_quietly, {"seconds": 60.0, "rate": 25}),
    ],
    ids=[
        "noise",
        "more noise than contact",
        "small counts cut",
        "quiet",
        "quiet near zero",
        "clipped at zero",
        "long saturation",
        "steady press",
        "shaking palm",
        "rubbing finger",
        "taps",
        "pats between slow scans",
        "counts of a coarse converter",
        "zero after its first scans",
        "less noise than rounding",
    ],
)
def test_sound_skin_has_no_faults(change, options):
    found = find_faults(change, **options)
    assert not any(faults or mask.any() for _, mask, faults in found)


@pytest.mark.parametrize(
    ("kind", "value", "start", "within", "options"),
    [
        ("stuck", 300, 3.0, 5.5, {}),
        ("dead", 0, 3.0, 5.5, {}),
        ("negative", -1, 3.0, 0.2, {}),
        ("saturated", 1000, 0.0, 5.5, {}),
        ("saturated", 1000, 3.0, 60.3, {"seconds": 66.0, "rate": 10}),
    ],
)
def test_fault_of_a_taxel_is_found_with_its_place_and_time(
    kind, value, start, within, options
):
    found = find_faults(set_counts(TAXEL, value, start), **options)
    assert describe(found) == [(kind, *PLACE)]
    _, mask, [fault] = found[-1]
    # A taxel was below full scale until one scan before.
    assert abs(fault.since - (START + start * SECOND)) <= 0.1 * SECOND
    assert np.flatnonzero(mask).tolist() == [TAXEL]
    assert start <= first_time(found) < start + within
    assert value != 1000 or first_time(found) > start + 0.9 * within


def test_negative_counts_are_masked_at_once():
    for t, mask, _ in find_faults(set_counts(TAXEL, -1, start=3.01), seconds=4.0):
        assert mask[TAXEL] == (t >= 3.01)


@pytest.mark.parametrize("rate", [25, 50])
def test_taxel_with_intermittent_contact_is_noisy_at_its_first_swing(rate):
    change = add_counts(TAXEL, lambda t: 400 * ((t + 1e-6) % 12.0 < 0.6))
    found = find_faults(change, seconds=14.0, rate=rate)
    assert describe(found) == [("noisy", *PLACE)]
    assert 12.0 <= first_time(found) < 12.6


@pytest.mark.parametrize(
    ("rate", "force"), [(10, 300), (25, 300), (50, 300), (10, 3000), (25, 3000)]
)
def test_finger_that_presses_one_taxel_again_and_again_is_no_fault(rate, force):
    rng = np.random.default_rng(3)
    forces = force * (1.0 + 0.2 * rng.standard_normal(20))

    def press(t):
        share = np.clip(min(t % 2.0, 0.7 - t % 2.0) / 0.06, 0.0, 1.0)
        return min(forces[int(t // 2.0)] * share, 800)

    found = find_faults(add_counts(TAXEL, press), 30.0, rate)
    assert not any(faults for _, _, faults in found)


def test_taxel_that_stays_away_from_its_rest_is_stuck_in_a_quiet_patch():
    def change(t, counts, received):
        round_quietly(t, counts, received)
        if t >= 3.0:
            counts[TAXEL] = 90

    found = find_faults(change, seconds=40.0, rate=25)
    assert describe(found) == [("stuck", *PLACE)]


def test_quiet_taxel_that_ignores_presses_around_it_is_dead():
    def change(t, counts, received):
        counts[AROUND] += 300 * (t % 4.0 > 2.0)
        counts[TAXEL] = 0

    found = find_faults(change, noise=0.0, rest=0, seconds=9.0)
    assert describe(found) == [("dead", *PLACE)]


def test_taxel_that_jumps_alone_is_noisy_until_it_stops():
    rng = np.random.default_rng(5)

    def change(t, counts, received):
        if 3.0 <= t < 12.0:
            counts[TAXEL] += round(80 * rng.standard_normal())

    found = find_faults(change, seconds=56.0, rate=20)
    [fault] = next(faults for t, _, faults in found if t >= 11.9)
    assert (fault.kind, fault.taxel) == ("noisy", TAXEL)
    assert 0 <= fault.since - (START + 3 * SECOND) < 2 * SECOND
    assert 3.2 < first_time(found) < 6.0
    assert all(mask[TAXEL] for t, mask, _ in found if 12.0 < t < 42.0)
    assert not found[-1][2]


def draw_noise(sigma):
    """Return a signal of noise."""
    rng = np.random.default_rng(6)
    return lambda t: sigma * rng.standard_normal()


@pytest.mark.parametrize(
    "signal",
    [toggle, *(draw_noise(share * 7.0) for share in (0.6, 1.0, 3.0))],
    ids=["steps", "less than contact", "as much", "more"],
)
def test_taxel_that_steps_or_jitters_alone_is_noisy(signal):
    found = find_faults(add_counts(TAXEL, signal, 0.0), noise=0.5, seconds=6.0)
    assert describe(found) == [("noisy", *PLACE)]


@pytest.mark.parametrize("rate", [50, 30, 12])
def test_taxel_that_spikes_alone_is_noisy_at_any_rate(rate):
    rng = np.random.default_rng(8)
    change = add_counts(TAXEL, lambda t: 30 * (rng.random() < 0.5))
    found = find_faults(change, noise=0.5, seconds=20.0, rate=rate)
    assert describe(found) == [("noisy", *PLACE)]


def hide(t, counts, received):
    """Add noise of a patch that hides any press."""
    rng = np.random.default_rng(round(1e6 * t))
    counts[36:] += np.round(60 * rng.standard_normal(36)).astype(int)


@pytest.mark.parametrize("lost", [0.0, 0.1])
def test_hand_on_rows_that_are_noisy_beside_it_is_doubtful_and_no_fault(lost):
    """A row-column array spreads the noise of a hand over its rows."""
    rows = (SKIN.patch_index == 0) & (SKIN.rows < 3)
    hand = rows & (SKIN.columns < 3)
    beside = rows & (SKIN.columns >= 3)
    rng = np.random.default_rng(7)

    def change(t, counts, received):
        received[:] = rng.random() >= lost
        if t >= 3:
            counts += 300 * hand
            noise = 15 * rng.standard_normal(SKIN.count) * beside
            counts += np.round(noise).astype(int)

    for t, detector in push_counts(change):
        if t > 6:
            assert detector.mask[beside].all() and not detector.mask[hand].any()
            assert detector.doubtful[hand].all()


@pytest.mark.parametrize(
    ("floating", "rising", "added"),
    [(1, 1, 150), (1, 1, -15), (2, 1, 150), (2, 2, 150)],
)
def test_rest_of_a_row_that_floats_in_part_is_not_trusted(floating, rising, added):
    """What lies on one row alone is out; on two, it may be a hand, and is doubtful."""
    row = np.where(SKIN.patch_index == 0, SKIN.rows, -1)
    half = SKIN.columns >= 3
    noisy = (row >= 0) & (row < floating) & half
    rest = (row >= 0) & (row < rising) & ~half
    rng = np.random.default_rng(7)

    def change(t, counts, received):
        if t >= 3:
            noise = 40 * rng.standard_normal(SKIN.count) * noisy
            counts += np.round(noise).astype(int)
        if t >= 6:
            counts += added * (noisy | rest)

    for t, detector in push_counts(change):
        if t > 5:
            assert detector.doubtful[rest].all()
            assert rising == 2 or detector.mask[rest].all()


@pytest.mark.parametrize(
    "change",
    [
        add_counts(np.arange(36, 72), hum, 0.0),
        add_counts(np.arange(36, 72), lambda t: 0.8 * hum(t), 3.0),
        hide,
    ],
    ids=["swings", "begins to swing", "noise"],
)
def test_patch_that_swings_or_hides_any_press_is_one_fault(change):
    found = find_faults(change, noise=0.5, seconds=6.0)
    assert describe(found) == [("patch", "p1", None, None, None)]


def test_taxel_is_doubtful_before_it_is_faulty_and_as_long_after_it():
    calibration = calibration_of(SKIN)
    detector = FrontEnd(SKIN, calibration)
    rng = np.random.default_rng(7)
    doubted = []
    masked = []
    for t in np.arange(400) / 50:
        counts = np.full(SKIN.count, 200)
        counts[TAXEL] += round(5 * rng.standard_normal())
        scan = scan_at(t, counts)
        detector.make_reading(scan)
        doubted.append(bool(detector.doubtful[TAXEL]))
        masked.append(bool(detector.mask[TAXEL]))
    assert doubted.index(True) < masked.index(True)
    assert all(d >= m for d, m in zip(doubted, masked, strict=True))


def find_doubtful(change, skin=SKIN, seconds=3.0):
    """Push counts at rest, changed from 2.5 s on; return which taxels are doubtful."""
    calibration = calibration_of(skin)
    detector = FrontEnd(skin, calibration)
    for t in np.arange(round(50 * seconds)) / 50:
        counts = np.full(skin.count, 200)
        if t > 2.5:
            change(counts)
        scan = scan_at(t, counts)
        detector.make_reading(scan)
    return detector.doubtful


ROW = (SKIN.rows == 2) & (SKIN.patch_index == 1)
MIXED = np.array([20, -20, 40, -40, 0, 20])
EVEN = np.array([100, 105, 95, 100, 110, 98])
HAND = np.array([10, 60, 200, 240, 90, 12])


@pytest.mark.parametrize(
    ("counts", "doubted"), [(MIXED, True), (EVEN, True), (HAND, False)]
)
def test_row_that_no_hand_presses_so_is_doubtful_at_once(counts, doubted):
    def change(all_counts):
        all_counts[ROW] += counts

    np.testing.assert_array_equal(find_doubtful(change), ROW & doubted)


@pytest.mark.parametrize(("below", "doubted"), [([-20, 0], False), ([-20, -20], True)])
def test_pressed_taxel_and_a_released_one_do_not_make_a_short_row_doubtful(
    below, doubted
):
    skin = build_grid_skin(columns=5)
    row = skin.rows == 2

    def change(counts):
        counts[row] += [60, *below, 0, 0]

    np.testing.assert_array_equal(find_doubtful(change, skin), row & doubted)


@pytest.mark.parametrize(
    ("sigma", "others", "doubted"),
    [(1.6, 0.0, False), (3.0, 0.0, True), (3.5, 2.1, False), (5.5, 1.0, True)],
    ids=["little noise", "much", "little more than the patch", "five times that"],
)
def test_noise_makes_a_taxel_doubtful_if_it_is_much_and_its_own(sigma, others, doubted):
    """Contact begins at 7 counts; noise of 2.1 counts deviates by half of that."""
    rng = np.random.default_rng(8)

    def change(counts):
        noise = rng.standard_normal(len(counts)) * others
        noise[TAXEL] = sigma * rng.standard_normal()
        counts += np.round(noise).astype(int)

    assert find_doubtful(change, seconds=8.0)[TAXEL] == doubted


def test_noise_of_half_a_count_makes_no_taxel_doubtful_by_chance():
    """Many taxels do not change, and the running medians of others scatter."""
    rng = np.random.default_rng(8)

    def change(counts):
        counts += np.round(0.5 * rng.standard_normal(len(counts))).astype(int)

    assert not find_doubtful(change, seconds=25.0).any()


@pytest.mark.parametrize(
    ("kind", "patch", "row", "column", "value", "seconds"),
    [
        ("row", "p1", 2, None, 0, 5.0),
        ("column", "p1", None, 4, 0, 5.0),
        ("row", "p0", 5, None, 250 + np.arange(6), 12.0),
    ],
)
def test_line_out_is_one_fault(kind, patch, row, column, value, seconds):
    line = SKIN.rows == row if column is None else SKIN.columns == column
    line = line & (SKIN.patch_index == int(patch[1]))
    found = find_faults(set_counts(line, value), seconds)
    assert describe(found) == [(kind, patch, row, column, None)]
    np.testing.assert_array_equal(found[-1][1], line)


def test_row_that_floats_is_out_though_half_of_it_stays_at_zero():
    """Some of its taxels rest near zero, where converters cut what is below."""
    rng = np.random.default_rng(4)
    line = ROW & (SKIN.columns < 3)

    def change(t, counts, received):
        counts[ROW] = 0
        counts[line] = np.maximum(250 + 80 * rng.standard_normal(3), 1)

    found = find_faults(change, seconds=4.0)
    assert describe(found) == [("row", "p1", 2, None, None)]


def test_silent_patch_is_one_fault():
    def change(t, counts, received):
        received[36:] = t < 3.0

    found = find_faults(change, seconds=5.0)
    assert describe(found) == [("patch", "p1", None, None, None)]
    assert found[-1][2][0].since == START + round(2.98 * SECOND)


@pytest.mark.parametrize(("value", "latch"), [(300, 30.0), (0, 30.0), (-1, 0.5)])
def test_taxel_is_trusted_again_some_time_after_its_fault(value, latch):
    end = 12.0 + latch
    found = find_faults(set_counts(TAXEL, value, end=12.0), end + 3.0, rate=20)
    assert all(mask[TAXEL] for t, mask, _ in found if 11.0 < t < end)
    assert not any(mask[TAXEL] for t, mask, _ in found if t > end + 2.0)
    assert not found[-1][2]


def test_faults_do_not_depend_on_the_rate():
    def change(t, counts, received):
        set_counts(TAXEL, 300)(t, counts, received)
        counts[:6] = -1

    slow, fast = (describe(find_faults(change, 12.0, rate)) for rate in (10, 50))
    assert len(slow) == 2 and slow == fast


def test_dead_row_and_the_dead_column_that_it_crosses_are_two_faults():
    row = (SKIN.patch_index == 1) & (SKIN.rows == 2)
    column = (SKIN.patch_index == 1) & (SKIN.columns == 3)
    found = find_faults(set_counts(row | column, 0), seconds=8.0)
    assert describe(found) == [
        ("row", "p1", 2, None, None),
        ("column", "p1", None, 3, None),
    ]


@pytest.mark.parametrize("start", [0.0, 3.0], ids=["from the start", "later"])
def test_dead_row_of_a_patch_with_an_offset_is_found_within_two_seconds(start):
    row = (SKIN.patch_index == 1) & (SKIN.rows == 2)
    found = find_faults(set_counts(row, 0, start), rest=20, seconds=6.0)
    assert describe(found) == [("row", "p1", 2, None, None)]
    assert start < first_time(found) < start + 2.0


def test_time_without_data_makes_no_taxel_stuck():
    def change(t, counts, received):
        """Let every fifth taxel change once a second, and the others at each scan."""
        rng = np.random.default_rng(round(1e6 * t))
        counts[:] = 40 + rng.integers(0, 6, len(counts))
        counts[::5] = 40 + int(t) % 2
        received[:] = not 3.2 <= t < 8.8

    found = find_faults(change)
    assert not any(faults for t, _, faults in found if t >= 8.8)
