"""This module draws people: their sizes, their strength and how they touch."""

from dataclasses import dataclass

import numpy as np

from eskin.sim.constants import MM, Constants
from eskin.sim.contact.press import ContactPads, SoftTissue
from eskin.sim.people.hand import (
    PAD_GROUPS,
    build_hand,
    mirror_pads,
    select_pads,
    splay_fingers,
)

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

        Args:
            group: one of `eskin.sim.people.hand.PAD_GROUPS`.
            splay: angle between neighbouring fingers [rad].

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
    """Draw a person's own weights around those of the population."""
    weights = constants.weights(name)
    concentration = constants.value("person.style_concentration")
    own = rng.dirichlet(concentration * np.array(list(weights.values())))
    return {key: float(weight) for key, weight in zip(weights, own, strict=True)}
