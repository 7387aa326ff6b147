"""This module builds a hand as 20 pads that bear load, and other bodies as one pad."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import MM, Constants
from eskin.sim.contact.press import ContactPads

FINGERS = ("index", "middle", "ring", "little")
HAND_PADS = (
    *(f"{finger}_{part}" for part in ("tip", "mid", "base") for finger in FINGERS),
    *("thumb_tip", "thumb_base"),
    *("index_head", "middle_head", "little_head", "thenar", "hypothenar", "palm"),
)
"""Names of the pads of a hand, in order."""

TIPS, THUMB, HEADS, HEEL = (
    HAND_PADS[:4],
    HAND_PADS[12:14],
    HAND_PADS[14:17],
    HAND_PADS[17:],
)
PAD_GROUPS: dict[str, tuple[str, ...]] = {
    "one_tip": HAND_PADS[:1],
    "two_tips": HAND_PADS[:2],
    "tips": TIPS,
    "thumb": HAND_PADS[12:13],
    "one_finger": ("index_tip", "index_mid"),
    "two_fingers": ("index_tip", "index_mid", "middle_tip", "middle_mid"),
    "finger_ends": HAND_PADS[:8],
    "fingers": HAND_PADS[:12],
    "flat_hand": HAND_PADS[:12] + HEADS + HEEL,
    "full_hand": HAND_PADS,
    "fingers_thumb": HAND_PADS[:12] + THUMB,
    "tips_thumb": TIPS + THUMB,
    "clasp": HAND_PADS[:12] + HEADS,
    "heel": HEEL,
}
"""Pads that variants of gestures use, by name of the group."""

PAD_ROWS = np.array([0] * 4 + [1] * 4 + [2] * 4 + [3, 4] + [5] * 3 + [6, 7, 8])
"""Item of each pad in the lists of the constants `hand.radius_across` and so on."""


def build_hand(
    fingers: Float[np.ndarray, "4"],
    thumb: float,
    breadth: float,
    palm: float,
    length: float,
    constants: Constants,
) -> ContactPads:
    """Build a flat left hand, seen from its back as it lies on the skin.

    Args:
        fingers: lengths of index to little finger [m].
        thumb: length of the thumb [m].
        breadth: breadth of the hand [m].
        palm: length of the palm [m].
        length: length of the hand [m].
        constants: constants of the average hand.
    """
    across = breadth / (constants.value("hand.breadth") * MM)
    up = palm / (constants.value("hand.palm_length") * MM)
    scale = length / (constants.value("hand.length") * MM)
    reach = thumb / (constants.value("hand.thumb") * MM)
    thumbs = compute_thumb_positions(constants, across, up, reach)
    bases = constants.array("hand.finger_base") * MM * up
    sides = constants.array("hand.finger_side") * MM * across
    along = constants.array("hand.along")
    x = np.concatenate(
        [np.tile(sides, len(along)), thumbs[:, 0]]
        + [constants.array("hand.palm_side") * MM * across]
    )
    y = np.concatenate(
        [(bases + along[:, None] * fingers).ravel(), thumbs[:, 1]]
        + [constants.array("hand.palm_height") * MM * up]
    )
    return ContactPads(
        np.column_stack([x, y]),
        build_pad_radii(constants) * scale,
        compute_pad_angles(thumbs),
        constants.array("hand.area")[PAD_ROWS] * MM**2,
        constants.array("hand.most")[PAD_ROWS] * MM**2 * scale**2,
        constants.array("hand.stiffness")[PAD_ROWS],
    )


def compute_thumb_positions(
    constants: Constants, across: float, up: float, reach: float
) -> Float[np.ndarray, "2 2"]:
    """Return where tip and proximal pad of the thumb lie [m]."""
    usual = [constants.array(f"hand.thumb_{way}") for way in ("side", "height")]
    tip, base = np.column_stack(usual) * MM
    root = base * [across, up]
    return np.stack([root + (tip - base) * reach, root])


def build_pad_radii(constants: Constants) -> Float[np.ndarray, "part 2"]:
    """Return the radii of curvature of the average hand's pads [m]."""
    both = [constants.array(f"hand.radius_{way}") for way in ("across", "along")]
    return np.column_stack(both)[PAD_ROWS] * MM


def compute_pad_angles(thumbs: Float[np.ndarray, "2 2"]) -> Float[np.ndarray, "part"]:
    """Return the angles of the pads: the thumb's own, and 0 of all others."""
    turns = np.zeros(len(HAND_PADS))
    to_tip = thumbs[0] - thumbs[1]
    turns[12:14] = -np.arctan2(to_tip[0], to_tip[1])
    return turns


def mirror_pads(pads: ContactPads) -> ContactPads:
    """Return the pads of the other hand."""
    return replace(pads, centres=pads.centres * [-1.0, 1.0], angles=-pads.angles)


def select_pads(pads: ContactPads, names: tuple[str, ...]) -> ContactPads:
    """Return some pads of a whole hand."""
    rows = np.array([HAND_PADS.index(name) for name in names])
    return ContactPads(
        pads.centres[rows],
        pads.radii[rows],
        pads.angles[rows],
        pads.area[rows],
        pads.max_area[rows],
        pads.stiffness[rows],
    )


def splay_fingers(hand: ContactPads, angle: float) -> ContactPads:
    """Return a whole hand with its fingers fanned out.

    Args:
        hand: all 20 pads.
        angle: angle between neighbouring fingers [rad]; negative closes them.
    """
    centres, turns = hand.centres.copy(), hand.angles.copy()
    thumb_side = np.sign(centres[0, 0] - centres[3, 0])
    for finger in range(len(FINGERS)):
        rows = np.arange(finger, 12, len(FINGERS))
        turn = -thumb_side * angle * (1.5 - finger)
        root = centres[rows[-1]]
        arms = (centres[rows] - root)[:, 1]
        centres[rows] = root + arms[:, None] * [-np.sin(turn), np.cos(turn)]
        turns[rows] += turn
    return replace(hand, centres=centres, angles=turns)


def build_body(name: str, constants: Constants) -> ContactPads:
    """Build a body that is no hand: knuckle, forearm, torso, cable or edge.

    Raises:
        ValueError: there is no such body.
    """
    return ContactPads(
        np.zeros((1, 2)),
        constants.array(f"body.{name}.radii")[None] * MM,
        np.zeros(1),
        np.array([constants.value(f"body.{name}.area")]) * MM**2,
        np.array([constants.value(f"body.{name}.most")]) * MM**2,
        np.ones(1),
    )
