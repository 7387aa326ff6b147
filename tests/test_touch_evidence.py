"""Tests of contact by evidence: noise opens no touch, and no touch loses its onset."""

import numpy as np
import pytest

from helpers.touch import (
    SECOND,
    START,
    build_mounted_grid,
    build_pipeline,
    press_pad,
    reading_at,
    scan_at,
)

MOUNTED = build_mounted_grid()
SKIN = MOUNTED.skin
RATE = 50
LONE = 14
BESIDE = 15
PAD = press_pad(SKIN, (0.02, 0.02), kpa=1.0, radius=0.015)
"""Share of a press on each taxel of a pad."""
WIDE = np.ones(SKIN.count)


def push_counts(added, seconds, noise=1.0, noisy=None):
    """Push scans at rest plus `added(t)`; return the touches ever seen, by id."""
    rng = np.random.default_rng(5)
    pipeline = build_pipeline(MOUNTED)
    seen = {}
    sigma = np.full(SKIN.count, noise)
    if noisy is not None:
        sigma[LONE] = noisy
    for t in np.arange(round(seconds * RATE)) / RATE:
        counts = 200 + sigma * rng.standard_normal(SKIN.count) + added(t)
        state = pipeline.push_scan(scan_at(t, np.round(counts)))
        for touch in (*state.touches, *state.closed_touches):
            seen[touch.id] = touch
    return seen, state


def press(shape, start, end, counts, ramp=0.06):
    """Return counts that rise on a shape, stay, and fall."""

    def added(t):
        share = np.clip(min(t - start, end - t) / ramp, 0.0, 1.0)
        return share * counts * shape

    return added


def one_taxel(taxel=LONE):
    """Return the shape of one taxel."""
    return (np.arange(SKIN.count) == taxel).astype(float)


@pytest.mark.parametrize(
    "added",
    [
        lambda t: 600 * one_taxel() * (abs(t - 5.0) < 0.01),
        lambda t: 400 * one_taxel() * (t >= 5.0),
        lambda t: 400 * one_taxel() * (5.0 <= t < 5.5),
        lambda t: (400 + 40 * (-1) ** round(RATE * t)) * one_taxel() * (t >= 5.0),
    ],
    ids=["a corrupt value", "a jump that stays", "a swing", "a jump that swings"],
)
def test_electrical_event_of_one_taxel_opens_no_touch(added):
    assert not push_counts(added, 8.0)[0]


def test_noise_of_one_taxel_opens_no_touch():
    assert not push_counts(lambda t: 0.0, 10.0, noisy=5.0)[0]


def late_by(touch, seconds):
    """Return how long after a time a touch begins [s]."""
    return (touch.onset - START) / SECOND - seconds


PRESS = press(PAD, 8.0, 8.4, 200.0)


@pytest.mark.parametrize(
    ("added", "noisy"),
    [
        (press(one_taxel(), 8.0, 8.4, 200.0), None),
        (PRESS, None),
        (PRESS, 5.0),
        (lambda t: PRESS(t) + 100 * one_taxel(BESIDE) * (t >= 4.0), None),
        (lambda t: PRESS(t) + 150.0 * PAD * (t < 6.0), None),
    ],
    ids=["of one taxel", "of a pad", "beside noise", "beside a jump", "after a hand"],
)
def test_press_has_the_onset_of_its_first_scan(added, noisy):
    """Whatever its taxels or those beside them did before, or when switched on."""
    seen, _ = push_counts(added, 10.0, noisy=noisy)
    touch = seen[max(seen)]
    assert 0 <= late_by(touch, 8.0) <= 0.04
    assert touch.peak == pytest.approx(20.0, rel=0.1)
    assert all(one.last < START + 7 * SECOND for one in seen.values() if one != touch)


def wander(sigma, seconds=0.5, seed=11):
    """Return counts of taxels that wander about rest, each by itself."""
    rng = np.random.default_rng(seed)
    counts = np.zeros(SKIN.count)
    kept = np.exp(-1.0 / (RATE * seconds))

    def added(t):
        counts[:] = kept * counts + sigma * np.sqrt(1 - kept**2) * (
            rng.standard_normal(SKIN.count)
        )
        return counts.copy()

    return added


def test_skin_that_wanders_about_rest_soon_feels_presses_and_nothing_else():
    slow = wander(7.0)
    pad = press(PAD, 30.0, 30.4, 200.0)
    seen, _ = push_counts(lambda t: slow(t) + pad(t), 34.0)
    [touch] = [one for one in seen.values() if one.last > START + 15 * SECOND]
    assert abs(late_by(touch, 30)) <= 0.1


def pats_with_dips(t):
    """Return the counts of pats of a sensor that is below rest after each."""
    since = t % 2.2 - 0.3
    return 100.0 if since < 0.0 else -10.0 * np.exp(-since / 5.0)


@pytest.mark.parametrize(
    "force",
    [
        lambda t: 60 + 20 * np.sin(20 * t),
        lambda t: 10 * (t - 6.6),
        lambda t: 100 * (t % 1.0 < 0.3),
        pats_with_dips,
    ],
    ids=["a hand that trembles", "a press that grows slowly", "pats", "dips"],
)
def test_hand_is_not_taken_for_noise(force):
    floors = []
    for share in (0.0, 1.0):
        pipeline = build_pipeline(MOUNTED)
        rng = np.random.default_rng(5)
        for t in np.arange(20 * RATE) / RATE:
            counts = 200 + rng.standard_normal(SKIN.count)
            counts += share * force(t) * PAD * (t >= 6.6)
            pipeline.push_scan(scan_at(t, np.round(counts)))
        floors.append(pipeline.front_end.floor.copy())
    assert (floors[1] <= 1.5 * floors[0]).all()


def test_poke_of_a_hand_that_hovered_has_its_own_onset():
    hover = press(WIDE, 4.0, 6.5, 20.0)
    poke = press(PAD, 6.0, 6.4, 400.0)
    seen, _ = push_counts(lambda t: hover(t) + poke(t), 8.0)
    last = max(seen.values(), key=lambda touch: touch.peak_force)
    assert 0 <= late_by(last, 6) <= 0.06
    others = {touch.merged_into for touch in seen.values() if touch is not last}
    assert others == {last.id}


@pytest.mark.parametrize("hertz", [1.3, 2.7, 4.1])
def test_rest_stays_under_a_light_touch_that_lasts(hertz):
    pipeline = build_pipeline(MOUNTED)
    for t in np.arange(25 * RATE) / RATE:
        touch = (10.5 + 3.4 * np.sin(2 * np.pi * hertz * t)) * PAD * (t >= 5.0)
        state = pipeline.push_scan(scan_at(t, np.round(200 + touch)))
    # Contact begins at 7 counts, and they are clearly a touch from 14 on.
    assert state.contacts[0].taxels.tolist() == np.flatnonzero(PAD).tolist()
    assert pipeline.front_end.rest == pytest.approx(200, abs=0.1)


def test_contact_leaves_out_what_is_far_weaker_than_its_peak():
    pad = press(PAD, 5.0, 9.0, 400.0)
    halo = press(WIDE, 5.0, 9.0, 30.0)
    areas = []
    for added in (pad, lambda t: pad(t) + halo(t) * (PAD == 0)):
        _, state = push_counts(added, 6.0)
        areas.append(state.touches[0].contact.area)
    assert areas[0] == areas[1]


@pytest.mark.parametrize("counts", [20.0, 200.0])
def test_hand_that_rests_without_moving_stays_a_touch(counts):
    seen, state = push_counts(press(PAD, 5.0, 99.0, counts), 65.0)
    assert len(seen) == 1
    assert [touch.last for touch in state.touches] == [state.reading.stamp]


def test_hand_under_which_taxels_are_noisier_stays_a_touch_and_is_no_fault():
    rng = np.random.default_rng(3)
    hold = press(PAD, 5.0, 99.0, 40.0)

    def added(t):
        return hold(t) * (1 + 0.17 * rng.standard_normal(SKIN.count))

    seen, state = push_counts(added, 40.0)
    [touch] = seen.values()
    assert touch.last == state.reading.stamp and not state.faults
    assert len(touch.contact.taxels) == np.count_nonzero(PAD)


def test_remainder_of_a_touch_does_not_prolong_it():
    def added(t):
        remains = 30.0 * np.exp(-(t - 5.5) / 2.0) if t >= 5.5 else 0.0
        return press(PAD, 5.0, 5.5, 200.0)(t) + remains * PAD

    seen, _ = push_counts(added, 12.0)
    [touch] = seen.values()
    assert abs(touch.last - (START + round(5.5 * SECOND))) <= 0.1 * SECOND


@pytest.mark.parametrize(("counts", "loud"), [(100.0, 50.0), (14.0, 5.0)])
def test_taxels_that_a_hand_made_noisy_from_the_start_work_once_it_lifts(counts, loud):
    """Its noise may be as large as what it presses, and hide that it has lifted."""
    rng = np.random.default_rng(3)
    again = press(PAD, 10.0, 10.4, 200.0)
    sigma = np.where(np.arange(SKIN.count) % 3, 5.0, loud)

    def added(t):
        hand = counts + sigma * rng.standard_normal(SKIN.count)
        return again(t) + hand * (PAD > 0.2) * (t < 8.0)

    assert push_counts(added, 7.0)[1].faults
    seen, state = push_counts(added, 12.0)
    touch = seen[max(seen)]
    assert not state.faults
    assert 0 <= late_by(touch, 10) <= 0.04
    assert touch.peak == pytest.approx(20.0, rel=0.2)


FLOOR = np.full(SKIN.count, 0.7)
"""What may be noise on each taxel of a noisy skin [kPa]."""


def push_noisy(pressure, seconds, rate=RATE, valid=None):
    """Push readings of a noisy skin; return touches by id, and states."""
    pipeline = build_pipeline(MOUNTED)
    seen = {}
    states = []
    pipeline.front_end.taxels["floor"] = FLOOR
    for n in range(round(seconds * rate)):
        reading = reading_at(n / rate, pressure(n), valid and valid(n))
        states.append(pipeline.push_reading(reading))
        for touch in (*states[-1].touches, *states[-1].closed_touches):
            seen[touch.id] = touch
    return seen, states


def test_contacts_of_noise_neither_prolong_a_touch_nor_take_part_in_it():
    rng = np.random.default_rng(7)
    pad = press(PAD, 2.0, 2.4, 20.0)

    def pressure(n):
        noise = np.where(rng.random(SKIN.count) < 0.1, rng.uniform(0.7, 0.9), 0.0)
        return noise + pad(n / RATE)

    seen, _ = push_noisy(pressure, 8.0)
    [touch] = seen.values()
    assert 0 <= late_by(touch, 2) <= 0.04
    assert abs(touch.last - (START + round(2.4 * SECOND))) <= 0.04 * SECOND
    assert len(touch.tracks) == 1


@pytest.mark.parametrize("kpa", [5.0, 8.5, 20.0])
def test_taxel_that_stays_displaced_takes_no_later_touch_into_its_own(kpa):
    displaced = one_taxel(int(PAD.argmax()))
    beside = press_pad(SKIN, (0.045, 0.045), kpa=1.0, radius=0.012)

    def pressure(n):
        t = n / RATE
        first = press(PAD, 2.0, 2.4, 20.0)
        second = press(beside, 12.0, 12.4, kpa)
        return np.maximum(first(t), 8.0 * displaced * (t >= 2.2)) + second(t)

    seen, _ = push_noisy(pressure, 14.0)
    _, touch = seen.values()
    assert 0 <= late_by(touch, 12) <= 0.04
    assert touch.closed and touch.last <= START + 12.4 * SECOND


@pytest.mark.parametrize("tremor", [5.0, 20.0])
def test_finger_that_rests_on_one_taxel_stays_a_touch(tremor):
    def added(t):
        finger = press(one_taxel(), 5.0, 20.0, 150.0)(t)
        return finger + tremor * np.sin(2 * np.pi * t) * (finger > 100.0)

    seen, _ = push_counts(added, 21.0)
    [touch] = seen.values()
    assert touch.last >= START + 19.9 * SECOND


def test_corrupt_value_beside_noisy_taxels_does_not_hide_a_later_press():
    beside = 0.9 * press_pad(SKIN, SKIN.positions[LONE, :2], kpa=1.0, radius=0.012)
    pad = press(PAD, 2.0, 2.4, 5.0)
    sizes = []
    for corrupt in (0.0, 200.0):

        def pressure(n, corrupt=corrupt):
            return beside + corrupt * one_taxel() * (n == 50) + pad(n / RATE)

        seen, states = push_noisy(pressure, 2.2)
        sizes.append(len(states[-1].contacts[0].taxels))
    assert sizes[0] == sizes[1] > 1


def test_remainder_of_a_press_of_one_reading_does_not_prolong_it():
    def pressure(n):
        share = 1.0 if n == 10 else 0.15 * np.exp(-(n - 10) / 20) * (n > 10)
        return 20.0 * share * PAD

    seen, _ = push_noisy(pressure, 4.0, rate=10)
    [touch] = seen.values()
    assert touch.last == START + SECOND


def test_finger_that_meets_an_older_contact_of_noise_keeps_its_touch():
    weak, bridge, finger = SKIN.find_taxels(SKIN.patches[0].id)[[12, 13, 14]]

    def pressure(n):
        kpa = np.zeros(SKIN.count)
        kpa[weak] = 1.3 * (n >= 25)
        kpa[bridge] = 1.39 * (n >= 150)
        kpa[finger] = np.clip(n - 99, 0, 5) * 1.1
        return kpa

    _, states = push_noisy(pressure, 4.0)
    [touch] = [t for t in states[-1].touches if t.peak == pytest.approx(5.5)]
    assert 0 <= late_by(touch, 2) <= 0.04
    assert touch.last == states[-1].reading.stamp


def test_weak_contact_keeps_its_touch_while_it_is_not_received():
    weak = 0.75 * one_taxel()
    states = push_noisy(
        lambda n: weak, 1.0, valid=lambda n: (weak == 0) | (n < 20) | (n > 23)
    )[1]
    ids = {row.id for state in states for row in state.tracking.open}
    assert len(ids) == 1
