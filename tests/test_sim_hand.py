"""These tests check the pads of hands and of other bodies."""

import numpy as np

from eskin.sim import load_constants
from eskin.sim.people.person import HAND_PADS, build_hand, mirror_pads, splay_fingers

CONSTANTS = load_constants()


def build_average_hand(scale=1.0):
    fingers = np.array([63.9, 70.7, 65.5, 53.3]) * 1e-3
    thumb, breadth, palm, length = np.array([49.5, 83.2, 112.6, 187.0]) * 1e-3 * scale
    return build_hand(fingers * scale, thumb, breadth, palm, length, CONSTANTS)


HAND = build_average_hand()
TIP, THENAR, THUMB_TIP, THUMB_BASE = map(
    HAND_PADS.index, ("index_tip", "thenar", "thumb_tip", "thumb_base")
)


def test_average_hand_is_the_published_one():
    assert HAND.count == len(HAND_PADS) == 20
    np.testing.assert_allclose(HAND.centres[TIP], [0.030, 0.095 + 0.87 * 0.0639])
    np.testing.assert_allclose(HAND.radii[TIP], [0.008, 0.020])
    np.testing.assert_allclose(HAND.area[TIP], 90e-6)
    np.testing.assert_allclose(HAND.centres[THENAR], [0.030, 0.040])
    np.testing.assert_allclose(HAND.max_area[THENAR], 2200e-6)
    thumb = HAND.centres[THUMB_TIP] - HAND.centres[THUMB_BASE]
    turn = HAND.angles[THUMB_TIP]
    np.testing.assert_allclose(
        thumb / np.linalg.norm(thumb), [-np.sin(turn), np.cos(turn)], atol=1e-12
    )


def test_pads_scale_with_the_hand():
    large = build_average_hand(2.0)
    np.testing.assert_allclose(large.centres, 2 * HAND.centres)
    np.testing.assert_allclose(large.radii, 2 * HAND.radii)
    np.testing.assert_allclose(large.max_area, 4 * HAND.max_area)


def test_splayed_fingers_spread_and_keep_their_lengths():
    wide = splay_fingers(HAND, 0.1)
    assert np.ptp(wide.centres[:4, 0]) > np.ptp(HAND.centres[:4, 0])
    np.testing.assert_array_equal(wide.centres[8:], HAND.centres[8:])
    before, after = (
        np.linalg.norm(each.centres[:4] - each.centres[8:12], axis=1)
        for each in (HAND, wide)
    )
    np.testing.assert_allclose(before, after)
    np.testing.assert_allclose(
        mirror_pads(wide).centres, splay_fingers(mirror_pads(HAND), 0.1).centres
    )
