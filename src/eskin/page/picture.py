"""What the page is shown 25 times a second."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Float16, Float32, UInt8


@dataclass(frozen=True, eq=False)
class ContactMark:
    """Where something touches."""

    link: int
    """Index of the link."""

    p_link: Float[np.ndarray, "3"]
    """Centre in its frame [m]."""

    n_link: Float[np.ndarray, "3"]
    """Outward normal there."""

    radius: float
    """Of a circle of the same area [m]."""


@dataclass(frozen=True, eq=False)
class TouchNow:
    """An open touch and what is thought of it."""

    id: int
    """Its number."""

    link: str
    """Where it is."""

    force: float
    """Of its strongest contact [N]."""

    probabilities: Float32[np.ndarray, "class"]
    """Of the vocabulary."""


@dataclass(frozen=True)
class Saying:
    """A line of the log."""

    seconds: float
    """Since the stream began [s]."""

    kind: Literal["detection", "command", "refused", "event"]
    """What it is; a command may have been refused."""

    text: str
    """What is written."""

    gesture: str = ""
    """Of a detection."""

    link: int = -1
    """Index of the link of a detection; -1 of others."""

    p_link: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Where on that link [m]."""


@dataclass(frozen=True)
class ArmLine:
    """What an arm does, in words and numbers."""

    state: Literal["running", "paused", "held", "stopped", "waiting"]
    """`paused`: a person asked for it; `held`: stopped without being asked; `stopped`:
    protective stop or no connection; `waiting`: at rest in its program."""

    why: str
    """Of `held` and `stopped`."""

    speed: float
    """Share of full speed."""

    gripper: str
    """`open` or `closed`."""

    target: str
    """Where it goes."""


@dataclass(frozen=True, eq=False)
class Answer:
    """What a recogniser says of what is played in one pose."""

    said: tuple[str, ...]
    """In words, one line a touch."""

    right: bool | None
    """Whether that is what is truly done; None before all is said."""

    probabilities: Float32[np.ndarray, "class"]
    """Of the strongest touch."""


@dataclass(frozen=True)
class Board:
    """What two recognisers say of the same counts in two poses."""

    title: str
    """What is compared."""

    poses: tuple[str, ...]
    """Names."""

    done: tuple[str, ...]
    """What is truly done in each."""

    playing: int
    """The pose that the arm is in."""

    rows: tuple[tuple[str, tuple[Answer, ...]], ...]
    """What each recogniser is, and its answers, one a pose."""


@dataclass(frozen=True, eq=False)
class Picture:
    """One instant as the page shows it."""

    seconds: float
    """Since the stream began [s]."""

    poses: Float32[np.ndarray, "link 7"]
    """wxyz and position [m] of every link in the world."""

    pressure: Float16[np.ndarray, "taxel"]
    """[kPa]"""

    valid: UInt8[np.ndarray, "byte"]
    """Which taxels are believed, packed into bits."""

    contacts: tuple[ContactMark, ...]
    """Strongest first."""

    touches: tuple[TouchNow, ...]
    """Strongest first."""

    force: float
    """Of all contacts [N]."""

    peak: float
    """Greatest pressure [kPa]."""

    sayings: tuple[Saying, ...]
    """What was said since the last picture."""

    faults: int
    """How many are known."""

    rate: float
    """Readings a second [1/s]."""

    step: float
    """What recognising one reading takes, median [s]."""

    age: float
    """How old the reading was when all was said of it [s]."""

    arm: ArmLine | None = None
    """Where there is an arm."""

    board: Board | None = None
    """Where recognisers are compared."""
