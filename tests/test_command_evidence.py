"""Tests of evidence: a touch that a fault can imitate may stop, and nothing else."""

import numpy as np
import pytest

from helpers.commands import (
    FINGERTIP,
    HAND,
    PATCH,
    SKIN,
    Scene,
    find_block,
    make_map,
    make_paused_scene,
)

ROW = find_block(PATCH, 1, 8)
WHOLE = SKIN.find_taxels(PATCH.id)


def command(scene, gesture, **changes):
    """Make a touch of a fingertip, with changes; return the accepted actions."""
    changes = {"taxels": FINGERTIP} | changes
    before = len(scene.accepted)
    number = scene.begin(gesture)
    for name, value in changes.items():
        setattr(scene.touches[number], name, value)
    scene.wait(0.3)
    scene.detect(number)
    scene.wait(0.1)
    scene.lift(number)
    scene.wait(0.5)
    scene.close(number)
    return scene.accepted[before:]


FAULTY = [
    {"taxels": FINGERTIP[:1], "pressure": 200.0},
    {"taxels": ROW, "pressure": 200.0},
    {"taxels": WHOLE},
    {"pressure": 1.0},
]
FAULTY_NAMES = ["one taxel", "one row", "a whole patch", "weak"]


@pytest.mark.parametrize("changes", FAULTY, ids=FAULTY_NAMES)
@pytest.mark.parametrize("gesture", ["grab", "grab", "stroke"])
def test_touch_that_may_be_a_fault_commands_no_more_than_a_stop(changes, gesture):
    scene = Scene()
    assert command(scene, gesture, **changes) == []
    assert "fault of the skin" in scene.last_reason
    assert command(scene, "poke", **changes) == ["pause"]


@pytest.mark.parametrize("changes", FAULTY, ids=FAULTY_NAMES)
def test_touch_that_may_be_a_fault_does_not_resume(changes):
    scene = make_paused_scene()
    assert command(scene, "grab", **changes) == []
    scene.wait(1.0)
    assert command(scene, "grab", taxels=HAND) == ["resume"]


@pytest.mark.parametrize("taxels", [FINGERTIP, FINGERTIP[:2]], ids=["four", "two"])
def test_fingertip_commands(taxels):
    scene = Scene(make_map(stroke="next_waypoint"))
    assert command(scene, "stroke", taxels=taxels) == ["next_waypoint"]


@pytest.mark.parametrize(
    ("contact", "pressure", "enough"),
    [(0.1, 1.0, False), (0.1, 3.0, True), (0.7, 3.0, True), (5.0, 3.0, False)]
    + [(5.0, 9.0, False), (5.0, 11.0, True)],
)
def test_fingertip_needs_twice_the_pressure_of_contact(contact, pressure, enough):
    scene = Scene(make_map(stroke="next_waypoint"))
    scene.contact = contact
    commanded = command(scene, "stroke", pressure=pressure)
    assert commanded == ["next_waypoint"] * enough


BLOCK = find_block(PATCH, 4, 8).reshape(4, 8)
FINGERS = BLOCK[[0, 3], [1, 5]]
"""Taxels of two fingertips, in two rows and columns."""
ROOT = BLOCK[0, 2]
"""A taxel beside the first of them."""


def is_no_fault(*steps, scene=None, **changes):
    """Return whether a touch that presses some taxels after others is no fault.

    Args:
        steps: taxels, and the time for which they are pressed [s].
        scene: scene of the touch; a new one unless given.
        changes: attributes of the touch.
    """
    scene = scene or Scene()
    number = scene.begin("grab")
    for name, value in changes.items():
        setattr(scene.touches[number], name, value)
    for taxels, seconds in steps:
        scene.touches[number].taxels = np.atleast_1d(taxels)
        scene.wait(seconds)
    return scene.policy.evidence.is_plausible(number)


@pytest.mark.parametrize(
    ("steps", "enough"),
    [
        ([(ROOT, 0.02), (FINGERS, 0.3)], True),
        ([(ROOT, 0.02), (FINGERS[0], 0.16), (FINGERS, 0.3)], False),
        ([(FINGERS, 0.3)], False),
        ([(ROOT, 0.02), (BLOCK[0, [1, 5]], 0.3)], False),
        ([(ROOT, 0.02), (BLOCK[[0, 3], 1], 0.3)], False),
        ([(ROOT, 0.02), (FINGERS[0], 0.3)], False),
    ],
    ids=["together", "in turn", "nothing beside", "a row", "a column", "one alone"],
)
def test_fingertips_apart_are_no_fault_if_they_land_together(steps, enough):
    """Taxels with bad contacts are felt alone, and a finger that rolls is not."""
    assert is_no_fault(*steps) == enough
    assert not is_no_fault(*steps, pressure=1.0)


def doubt(scene, taxels):
    """Doubt taxels for a reading; return whether the first touch is no fault still."""
    scene.doubtful = np.isin(np.arange(SKIN.count), taxels)
    scene.step()
    return scene.policy.evidence.is_plausible(1)


def test_reading_without_data_does_not_let_fingertips_land_together():
    scene = Scene()
    steps = [(ROOT, 0.02), (FINGERS[0], 0.16), (FINGERS, 0.04)]
    assert not is_no_fault(*steps, scene=scene)
    scene.silent_patches = (PATCH.id,)
    scene.step()
    scene.silent_patches = ()
    scene.wait(0.2)
    assert not scene.policy.evidence.is_plausible(scene.count)


@pytest.mark.parametrize(("doubted", "enough"), [([0], True), ([0, 3], False)])
def test_fingertips_apart_do_not_both_lie_in_lines_of_doubtful_taxels(doubted, enough):
    scene, bad = Scene(), BLOCK[doubted, 7]
    assert is_no_fault((ROOT, 0.02), (np.append(bad, FINGERS), 0.3), scene=scene)
    assert doubt(scene, bad) == enough


@pytest.mark.parametrize("others", [BLOCK[3, [5]], BLOCK[2, [5]], BLOCK[3, [4, 6]]])
def test_faulty_row_and_taxels_elsewhere_do_not_support_each_other(others):
    """A row is pressed unevenly, and what else the touch feels is single taxels."""
    assert not is_no_fault((BLOCK[0], 0.2), (np.append(BLOCK[0], others), 0.3))


def test_path_along_a_row_of_which_more_is_pressed_is_a_fault():
    scene = Scene()
    scene.hidden[BLOCK[0, 7]] = 3.0
    assert not is_no_fault(*((taxel, 0.1) for taxel in BLOCK[0, :4]), scene=scene)


@pytest.mark.parametrize(
    ("path", "suffices"),
    [
        (find_block(PATCH, 1, 4), True),
        (find_block(PATCH, 2, 2), True),
        (find_block(PATCH, 1, 2), False),
        (find_block(PATCH, 1, 8)[::3], False),
    ],
    ids=["along a row", "round a block", "two in turn", "far apart"],
)
def test_fingertip_that_slides_over_single_taxels_is_no_fault(path, suffices):
    """Two taxels with bad contacts, or ones far apart, can be pressed by no finger."""
    assert is_no_fault(*((taxel, 0.1) for taxel in [*path, *path])) == suffices


@pytest.mark.parametrize(
    "faults",
    [
        (ROW[:6], find_block(PATCH, 2, 8)[8:14]),
        (FINGERTIP[-1:], ROW),
        (ROW, WHOLE[np.isin(SKIN.columns[WHOLE], SKIN.columns[ROW[:1]])]),
        (ROW[:1], ROW[1:2], WHOLE[-1:]),
    ],
    ids=["parts of two rows", "a taxel, a row", "a row, a column", "taxels far apart"],
)
def test_faults_in_turn_are_no_path(faults):
    assert not is_no_fault(*((taxels, 0.12) for taxels in 3 * faults))


def test_doubtful_taxels_are_no_evidence():
    scene = Scene()
    scene.doubtful = np.isin(np.arange(SKIN.count), FINGERTIP[:3])
    assert command(scene, "grab") == []


def test_taxels_of_a_faulty_row_are_no_evidence():
    scene = Scene(make_map(grab="slow"))
    wide = find_block(PATCH, 1, 2)
    scene.doubtful = (SKIN.rows == SKIN.rows[wide[0]]) & np.isin(
        np.arange(SKIN.count), WHOLE
    )
    assert command(scene, "grab", taxels=wide) == []


@pytest.mark.parametrize(
    ("doubted", "suffices"), [([0], True), ([0, 1], False), ([0, 3], False)]
)
def test_sound_taxels_do_not_both_lie_in_the_lines_of_doubtful_ones(doubted, suffices):
    """A fingertip presses a block: a row of it may be a fault, and so may a column."""
    scene = Scene()
    assert is_no_fault((FINGERTIP, 0.3), scene=scene)
    for _ in range(4):
        assert doubt(scene, FINGERTIP[doubted]) == suffices


def test_doubtful_taxel_that_is_pressed_later_counts_for_the_readings_before():
    scene = Scene()
    scene.doubtful[ROW[2]] = True
    assert is_no_fault((ROW[:2], 0.2), scene=scene)
    scene.touches[1].taxels = ROW[:3]
    assert not doubt(scene, ROW[2])


def test_row_that_noise_floors_hide_is_a_row_all_the_same():
    """All of a row is pressed, while only two taxels of it are in contact."""
    scene = Scene()
    scene.hidden[ROW[2:]] = 1.0
    assert not is_no_fault((ROW[:2], 0.3), scene=scene)


def test_taxel_that_becomes_doubtful_takes_no_more_than_its_row_and_column():
    scene, wide = Scene(), find_block(PATCH, 4, 4)
    assert is_no_fault((wide, 0.3), scene=scene)
    assert doubt(scene, wide[:1]) and not doubt(scene, wide)


def test_touch_that_has_pressed_a_taxel_loses_the_line_in_which_it_becomes_doubtful():
    scene = Scene()
    assert is_no_fault((ROW[6], 0.2), (ROW[:2], 0.2), scene=scene)
    assert not doubt(scene, ROW[6])


def test_taxel_that_is_first_pressed_as_it_becomes_doubtful_counts_as_pressed():
    scene = Scene()
    assert is_no_fault((ROW[:2], 0.3), scene=scene)
    scene.touches[1].taxels = ROW[:3]
    assert not doubt(scene, ROW[2])


@pytest.mark.parametrize("active", [True, False])
def test_line_counts_no_more_once_a_fifth_of_it_is_doubtful_and_active(active):
    scene = Scene()
    assert is_no_fault((ROW[:2], 0.3), scene=scene)
    if active:
        other = scene.begin("none")
        scene.touches[other].taxels = ROW[4:]
        scene.wait(0.1)
    assert doubt(scene, ROW[4]) and doubt(scene, ROW[4:]) != active


@pytest.mark.parametrize(("more", "suffices"), [(0, True), (1, False)])
def test_touch_along_a_line_covers_a_third_of_it_at_most(more, suffices):
    line = WHOLE[SKIN.rows[WHOLE] == SKIN.rows[ROW[0]]]
    assert is_no_fault((line[: int(0.34 * len(line)) + more], 0.3)) == suffices


def test_doubt_elsewhere_takes_nothing():
    scene = Scene()
    assert is_no_fault((FINGERTIP[:2], 0.3), scene=scene)
    assert doubt(scene, np.setdiff1d(np.arange(SKIN.count), WHOLE))


def test_touch_that_is_felt_too_briefly_commands_no_more_than_a_stop():
    for gesture, accepted in (("grab", []), ("poke", ["pause"])):
        scene = Scene()
        number = scene.begin(gesture)
        scene.wait(0.04)
        scene.lift(number)
        scene.detect(number)
        scene.wait(0.5)
        scene.close(number)
        assert scene.accepted == accepted
