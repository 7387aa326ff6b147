"""This module draws people: their hands, their strength and how they touch.

A hand is 20 pads that bear load; any other body is one pad.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import MM, Constants
from eskin.sim.contact.press import ContactPads, SoftTissue

STYLE_CONSTANTS = ("poke.kinds", "push.shape", "double_pat.kinds", "grab.kinds") + (
    "stroke.kinds",
    "stroke.path",
)
"""Constants whose weights vary between people."""

HABIT_GESTURES = ("poke", "double_pat", "grab", "stroke")
"""Gestures that a person does more firmly or slowly than the others."""


@dataclass(frozen=True, eq=False)
class Person:
    """A person touches the robot with a body and habits that are drawn once."""

    name: str
    """Name of the person in recordings."""
    sex: str
    """`man` or `woman`."""
    hand_length: float
    """Distance from the wrist's crease to the tip of the middle finger [m]."""
    hand_breadth: float
    """Breadth of the hand [m]."""
    palm_length: float
    """Length of the palm [m]."""
    thumb: float
    """Length of the thumb [m]."""
    fingers: tuple[float, float, float, float]
    """Lengths of index to little finger [m]."""
    acromion_height: float
    """Height of the shoulder [m]."""
    tissue: SoftTissue
    """Soft tissue of the hands."""
    force_scale: float
    """Firmness of touches relative to the average."""
    tempo_scale: float
    """Duration of touches relative to the average."""
    pat_interval: float
    """Time between the onsets of two pats [s]."""
    grip: float
    """Largest force of a grab on a tube of 76 mm [N]."""
    styles: dict[str, dict[str, float]]
    """Weights of the variants of gestures, by the constant that they vary."""
    firmness: dict[str, float]
    """Firmness of each gesture beside `force_scale`; standard normal."""
    pace: dict[str, float]
    """Slowness of each gesture beside `tempo_scale`; standard normal."""
    right_handed: bool
    """Whether the right hand touches."""
    stand: tuple[float, float]
    """Distance [m] and bearing [rad] of the person from the robot's base."""
    hand: ContactPads
    """Hand that touches, all 20 pads, flat, seen from its back."""

    def select_pads(self, group: str, splay: float = 0.0) -> ContactPads:
        """Return some pads of the hand.

        `group` is one of `PAD_GROUPS`; `splay` is the angle between neighbouring
        fingers [rad].

        Raises:
            ValueError: there is no such group.
        """
        if group not in PAD_GROUPS:
            raise ValueError(
                f"no parts '{group}' of a hand; choose from {[*PAD_GROUPS]}"
            )
        return select_pads(
            splay_fingers(self.hand, splay) if splay else self.hand, PAD_GROUPS[group]
        )


def draw_person(name: str, constants: Constants, rng: np.random.Generator) -> Person:
    """Draw a new person."""
    woman = rng.random() < constants.value("person.women")
    length, breadth, palm, acromion = draw_sizes(woman, constants, rng)
    thumb, *fingers = draw_fingers(length, constants, rng)
    right_handed = bool(rng.random() < constants.value("person.right_handed"))
    hand = build_hand(np.array(fingers), thumb, breadth, palm, length, constants)
    return Person(
        name=name,
        sex="woman" if woman else "man",
        hand_length=length,
        hand_breadth=breadth,
        palm_length=palm,
        thumb=thumb,
        fingers=(fingers[0], fingers[1], fingers[2], fingers[3]),
        acromion_height=acromion,
        tissue=draw_tissue(length, constants, rng),
        force_scale=constants.draw("person.force_scale", rng),
        tempo_scale=constants.draw("person.tempo_scale", rng),
        pat_interval=constants.draw("person.pat_interval", rng),
        grip=constants.draw("person.grip", rng),
        styles={style: draw_style(style, constants, rng) for style in STYLE_CONSTANTS},
        firmness={habit: float(rng.normal()) for habit in HABIT_GESTURES},
        pace={habit: float(rng.normal()) for habit in HABIT_GESTURES},
        right_handed=right_handed,
        stand=(
            constants.draw("person.stand_distance", rng),
            float(rng.uniform(-np.pi, np.pi)),
        ),
        hand=mirror_pads(hand) if right_handed else hand,
    )


def draw_sizes(
    woman: bool, constants: Constants, rng: np.random.Generator
) -> tuple[float, float, float, float]:
    """Draw hand length, breadth, palm length and height of the acromion [m].

    All correlate with hand length, and with each other as far as that makes them.
    """
    sex = "women" if woman else "men"
    shared = rng.normal()
    mean, deviation = constants.array(f"person.hand_length.{sex}")
    sizes = [(mean + deviation * shared) * MM]
    ways = ("hand_breadth", "palm_length", "acromion_height")
    shares = constants.array(f"person.correlation.{sex}")
    for way, share in zip(ways, shares, strict=True):
        mean, deviation = constants.array(f"person.{way}.{sex}")
        own = np.sqrt(1 - share**2) * rng.normal()
        sizes.append((mean + deviation * (share * shared + own)) * MM)
    length, breadth, palm, acromion = map(float, sizes)
    return length, breadth, palm, acromion


def draw_fingers(
    length: float, constants: Constants, rng: np.random.Generator
) -> list[float]:
    """Draw the lengths of thumb and index to little finger [m]."""
    usual = [constants.value("hand.thumb"), *constants.array("hand.fingers")]
    scale = length / constants.value("hand.length")
    return [
        float(scale * each * constants.draw("person.finger", rng)) for each in usual
    ]


def draw_tissue(
    length: float, constants: Constants, rng: np.random.Generator
) -> SoftTissue:
    """Draw the soft tissue of a hand of some length [m]."""
    scale = length / (constants.value("hand.length") * MM)
    return SoftTissue(
        b=constants.draw("person.stiffness", rng) / MM,
        m=constants.draw("person.stiffness_growth", rng) / MM,
        area_scale=scale**2 * constants.draw("person.area", rng),
        area_exponent=constants.draw("person.area_exponent", rng),
        conformity=constants.draw("person.conformity", rng),
    )


def draw_style(
    name: str, constants: Constants, rng: np.random.Generator
) -> dict[str, float]:
    """Draw a person's own weights around the population's."""
    weights = constants.weights(name)
    concentration = constants.value("person.style_concentration")
    own = rng.dirichlet(concentration * np.array(list(weights.values())))
    return {key: float(weight) for key, weight in zip(weights, own, strict=True)}


FINGERS = ("index", "middle", "ring", "little")
HAND_PADS = (
    *(f"{finger}_{part}" for part in ("tip", "mid", "base") for finger in FINGERS),
    "thumb_tip",
    "thumb_base",
    "index_head",
    "middle_head",
    "little_head",
    "thenar",
    "hypothenar",
    "palm",
)
"""Names of the pads of a hand, in order."""

TIPS = HAND_PADS[:4]
THUMB = HAND_PADS[12:14]
HEADS = HAND_PADS[14:17]
HEEL = HAND_PADS[17:]
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

    All lengths are in [m]; `fingers` go from index to little finger.
    """
    across = breadth / (constants.value("hand.breadth") * MM)
    up = palm / (constants.value("hand.palm_length") * MM)
    scale = length / (constants.value("hand.length") * MM)
    reach = thumb / (constants.value("hand.thumb") * MM)
    usual = [constants.array(f"hand.thumb_{way}") for way in ("side", "height")]
    tip, base = np.column_stack(usual) * MM
    root = base * [across, up]
    thumbs = np.stack([root + (tip - base) * reach, root])
    to_tip = thumbs[0] - thumbs[1]
    angles = np.zeros(len(HAND_PADS))
    angles[12:14] = -np.arctan2(to_tip[0], to_tip[1])
    radii = [constants.array(f"hand.radius_{way}") for way in ("across", "along")]
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
        np.column_stack(radii)[PAD_ROWS] * MM * scale,
        angles,
        constants.array("hand.area")[PAD_ROWS] * MM**2,
        constants.array("hand.most")[PAD_ROWS] * MM**2 * scale**2,
        constants.array("hand.stiffness")[PAD_ROWS],
    )


def mirror_pads(pads: ContactPads) -> ContactPads:
    """Return the pads of the other hand."""
    return replace(pads, centres=pads.centres * [-1.0, 1.0], angles=-pads.angles)


def select_pads(pads: ContactPads, names: tuple[str, ...]) -> ContactPads:
    """Return some pads of a whole hand."""
    rows = np.array([HAND_PADS.index(name) for name in names])
    return ContactPads(*(getattr(pads, each.name)[rows] for each in fields(pads)))


def splay_fingers(hand: ContactPads, angle: float) -> ContactPads:
    """Return a whole hand with its fingers fanned out.

    `angle` is that between neighbouring fingers [rad]; a negative one closes them.
    """
    centres = hand.centres.copy()
    turns = hand.angles.copy()
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
