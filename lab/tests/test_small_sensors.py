"""These tests check the touches by formula that test weights on unmet sensors."""

from types import SimpleNamespace

import numpy as np
import pytest

from eskin.live import UNKNOWN
from eskin.recording import NONE
from lab.small_sensors import (
    PARTS,
    REST_BEFORE,
    SHOWN,
    STEP,
    accept_few,
    accept_passing,
    beats,
    build_device,
    choose,
    draw_cells,
    draw_pads,
    format_table,
    press,
    rest,
    travel,
)

ROWS = [(part, name) for part, rows in PARTS.items() for name in rows]
SEEDS = range(20)


def draw_rng(seed):
    """Return the random numbers of a draw."""
    return np.random.default_rng(seed)


def detect(gesture, peak_force=1.0, likeliest=""):
    """Return the part of a detection that answers are chosen by."""
    return SimpleNamespace(gesture=gesture, peak_force=peak_force, likeliest=likeliest)


@pytest.mark.parametrize(("part", "name"), ROWS)
def test_draw_is_repeated_by_its_seed_and_silent_before_the_touch(part, name):
    row = PARTS[part][name]
    trial = row.draw(draw_rng(7))
    again = row.draw(draw_rng(7))
    np.testing.assert_array_equal(trial.pressure, again.pressure)
    assert trial.pressure.shape == (len(trial.times), trial.mounted.skin.count)
    assert np.all(np.diff(trial.times) > 0)
    assert np.all(np.isfinite(trial.pressure))
    assert trial.pressure.min() >= 0
    assert trial.pressure.max() >= SHOWN
    # Half a period of the slowest sensor is interpolated before the first contact.
    assert trial.pressure[trial.times < REST_BEFORE - 0.1].max() == 0


@pytest.mark.parametrize("seed", SEEDS)
def test_rest_lasts_as_said_and_its_pads_begin_within_80_ms(seed):
    rng = draw_rng(seed)
    device = draw_pads(rng, apart=True)
    touch = rest(rng, device, 0.6, 1.0)
    seconds = len(touch.force) * STEP
    assert 0.6 - STEP <= seconds <= 1.0 + STEP
    first = np.argmax(touch.force > 0, axis=0)
    assert np.ptp(first) * STEP <= 0.08 + STEP
    last = np.argmax(touch.force[::-1] > 0, axis=0)
    assert last.max() * STEP <= (0 if touch.stays else 0.08 + STEP)


@pytest.mark.parametrize("seed", SEEDS)
def test_body_rests_on_one_to_four_cells(seed):
    rng = draw_rng(seed)
    device = draw_pads(rng, apart=bool(seed % 2))
    pressure = press(rest(rng, device, 1.0, 3.0), device)
    assert 1 <= (pressure.max(0) > 0.02 * pressure.max()).sum() <= 4


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("apart", [False, True])
def test_large_cells_do_not_overlap(seed, apart):
    device = draw_pads(draw_rng(seed), apart, least=2)
    assert 2 <= device.skin.count <= 12
    assert 0.025 <= device.side <= 0.09
    away = np.abs(device.centres[:, None] - device.centres).max(-1)
    np.fill_diagonal(away, np.inf)
    assert away.min() == pytest.approx(device.pitch)
    assert 0.06 <= device.pitch <= 0.16 if apart else device.pitch == device.side


@pytest.mark.parametrize("seed", SEEDS)
def test_poke_travels_as_far_as_said(seed):
    rng = draw_rng(seed)
    device = draw_cells(rng, 0.003, 0.010)
    touch = travel(rng, device, (0.010, 0.015), (0.15, 0.8), poked=True)
    length = np.linalg.norm(touch.places[-1, 0] - touch.places[0, 0])
    assert 0.010 <= length <= 0.015


@pytest.mark.parametrize("count", [2, 3])
@pytest.mark.parametrize("seed", SEEDS)
def test_beats_are_counted_and_hardly_press_between(seed, count):
    rng = draw_rng(seed)
    device = draw_cells(rng, 0.025, 0.035)
    touch = beats(rng, device, count)
    pressed = touch.force[:, 0] > 0.051
    assert np.count_nonzero(np.diff(pressed, prepend=False, append=False)) == 2 * count
    middles = touch.places.mean(1)[pressed]
    moved = np.linalg.norm(np.diff(middles, axis=0), axis=1)
    assert moved.max() <= device.pitch + 1e-9


def test_cells_are_accepted_by_number_and_travel():
    device = build_device(1, 6, 0.03)
    passing = 10 * np.eye(6)
    assert accept_passing(passing, device)
    assert not accept_passing(np.tile(passing[:1], (5, 1)), device)
    assert not accept_passing(np.ones((5, 6)) * 10, device)
    assert not accept_few(passing, device)
    assert accept_few(passing[:4], device)
    assert not accept_few(passing[:1], device)


def test_live_answer_is_every_gesture_and_forced_that_of_greatest_force():
    strong = detect(UNKNOWN, 2.0, "stroke")
    assert choose([]) == (NONE, NONE)
    assert choose([strong, detect(NONE)]) == ("stroke", UNKNOWN)
    assert choose([strong, detect("poke")]) == ("stroke", "poke")
    assert choose([detect(NONE, 2.0), detect(UNKNOWN)]) == (NONE, NONE)
    both = [detect("stroke", 2.0), detect("poke"), detect("poke")]
    assert choose(both) == ("stroke", "poke and stroke")


def test_table_counts_right_missed_and_wrong_answers():
    found = [
        ("a", "poke", "poke", "poke"),
        ("a", "poke", "poke", "poke and stroke"),
        ("a", "poke", "none", UNKNOWN),
        ("a", "poke", "stroke", NONE),
        ("b", NONE, NONE, NONE),
    ]
    lines = format_table(found).splitlines()
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines[2:]]
    assert [row[0] for row in cells] == ["a", "b", "all"]
    assert [row[2] for row in cells] == ["4", "1", "5"]
    shares = [[cell.split(" ")[0] for cell in row[3:]] for row in cells]
    assert shares[0] == ["50%", "25%", "25%"]
    assert shares[1] == ["100%", "100%", "0%"]
    assert shares[2] == ["60%", "40%", "20%"]
    assert cells[0][5].endswith("poke and stroke 1")
