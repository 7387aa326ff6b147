import numpy as np
import pytest

from eskin.sim.constants import load_constants
from eskin.sim.people.hand import (
    HAND_PADS,
    PAD_GROUPS,
    build_body,
    build_hand,
    mirror_pads,
    select_pads,
    splay_fingers,
)

CONSTANTS = load_constants()


def average(scale=1.0):
    fingers = np.array([63.9, 70.7, 65.5, 53.3]) * 1e-3
    sizes = [each * 1e-3 for each in (49.5, 83.2, 112.6, 187.0)]
    thumb, breadth, palm, length = (each * scale for each in sizes)
    return build_hand(fingers * scale, thumb, breadth, palm, length, CONSTANTS)


def test_the_average_hand_is_the_published_table():
    hand = average()
    assert hand.count == len(HAND_PADS) == 20
    tip, thenar = HAND_PADS.index("index_tip"), HAND_PADS.index("thenar")
    np.testing.assert_allclose(hand.centres[tip], [0.030, 0.095 + 0.87 * 0.0639])
    np.testing.assert_allclose(hand.radii[tip], [0.008, 0.020])
    np.testing.assert_allclose(hand.area[tip], 90e-6)
    np.testing.assert_allclose(hand.centres[thenar], [0.030, 0.040])
    np.testing.assert_allclose(hand.max_area[thenar], 2200e-6)


def test_a_hand_twice_as_large_is_twice_as_large():
    small, large = average(), average(2.0)
    np.testing.assert_allclose(large.centres, 2 * small.centres)
    np.testing.assert_allclose(large.radii, 2 * small.radii)
    np.testing.assert_allclose(large.max_area, 4 * small.max_area)


def test_mirroring_twice_changes_nothing_and_once_changes_sides():
    hand = average()
    other = mirror_pads(hand)
    np.testing.assert_array_equal(other.centres[:, 0], -hand.centres[:, 0])
    np.testing.assert_array_equal(other.centres[:, 1], hand.centres[:, 1])
    np.testing.assert_array_equal(other.angles, -hand.angles)
    np.testing.assert_array_equal(mirror_pads(other).centres, hand.centres)


def test_the_thumb_points_from_its_base_to_its_tip():
    hand = average()
    tip, base = HAND_PADS.index("thumb_tip"), HAND_PADS.index("thumb_base")
    way = hand.centres[tip] - hand.centres[base]
    turn = hand.angles[tip]
    np.testing.assert_allclose(
        way / np.linalg.norm(way), [-np.sin(turn), np.cos(turn)], atol=1e-12
    )


def test_groups_name_parts_that_exist_once():
    for names in PAD_GROUPS.values():
        assert set(names) <= set(HAND_PADS) and len(set(names)) == len(names)
        assert select_pads(average(), names).count == len(names)
    assert PAD_GROUPS["full_hand"] == HAND_PADS


def test_splaying_widens_the_fingertips_and_keeps_the_lengths():
    hand = average()
    for side in (hand, mirror_pads(hand)):
        wide, tips = splay_fingers(side, 0.1), slice(0, 4)
        assert np.ptp(wide.centres[tips, 0]) > np.ptp(side.centres[tips, 0])
        np.testing.assert_array_equal(wide.centres[8:], side.centres[8:])
        before, after = (
            np.linalg.norm(each.centres[tips] - each.centres[8:12], axis=1)
            for each in (side, wide)
        )
        np.testing.assert_allclose(before, after)
    np.testing.assert_allclose(
        mirror_pads(splay_fingers(hand, 0.1)).centres,
        splay_fingers(mirror_pads(hand), 0.1).centres,
    )


def test_other_bodies_are_one_part_and_unknown_ones_are_refused():
    torso, knuckle = build_body("torso", CONSTANTS), build_body("knuckle", CONSTANTS)
    assert torso.count == knuckle.count == 1
    assert torso.area[0] > knuckle.area[0]
    with pytest.raises(ValueError, match="body.wing"):
        build_body("wing", CONSTANTS)
