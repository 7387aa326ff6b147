"""This module defines what the page and its viewer send each other."""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Float16, Float32, Int, UInt8


@dataclass(frozen=True, eq=False)
class ContactMarker:
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
class OpenTouch:
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
class LogEntry:
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
class ArmSummary:
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
class ComparisonBoard:
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
class ViewUpdate:
    """One instant as the page shows it."""

    seconds: float
    """Since the stream began [s]."""

    poses: Float32[np.ndarray, "link 7"]
    """wxyz and position [m] of every link in the world."""

    pressure: Float16[np.ndarray, "taxel"]
    """[kPa]"""

    valid: UInt8[np.ndarray, "byte"]
    """Which taxels are believed, packed into bits."""

    contacts: tuple[ContactMarker, ...]
    """Strongest first."""

    touches: tuple[OpenTouch, ...]
    """Strongest first."""

    force: float
    """Of all contacts [N]."""

    peak: float
    """Greatest pressure [kPa]."""

    log_entries: tuple[LogEntry, ...]
    """What was said since the last picture."""

    faults: int
    """How many are known."""

    rate: float
    """Readings a second [1/s]."""

    step: float
    """What recognising one reading takes, median [s]."""

    age: float
    """How old the reading was when all was said of it [s]."""

    arm: ArmSummary | None = None
    """Where there is an arm."""

    board: ComparisonBoard | None = None
    """Where recognisers are compared."""


@dataclass(frozen=True, eq=False)
class LinkMesh:
    """A part of the robot as it looks: a closed mesh in the frame of its link."""

    link: int
    """Index of its link."""

    vertices: Float[np.ndarray, "vertex 3"]
    """[m]"""

    faces: Int[np.ndarray, "face 3"]
    """Counter-clockwise when seen from outside."""

    colour: tuple[int, int, int]
    """Red, green and blue, each to 255."""


@dataclass(frozen=True, eq=False)
class SceneDescription:
    """A skin on its robot, and what people may do with it."""

    title: str
    """What is seen: robot, skin and source."""

    links: tuple[str, ...]
    """Of the robot."""

    solids: tuple[LinkMesh, ...]
    """What the robot looks like."""

    taxel_link: Int[np.ndarray, "taxel"]
    """Index of each taxel's link."""

    positions: Float[np.ndarray, "taxel 3"]
    """Of the taxels in the frames of their links [m]."""

    normals: Float[np.ndarray, "taxel 3"]
    """Outward, unit, in the same frames."""

    areas: Float[np.ndarray, "taxel"]
    """[m2]"""

    patches: tuple[str, ...]
    """Names."""

    patch_index: Int[np.ndarray, "taxel"]
    """The patch of each taxel."""

    gestures: tuple[str, ...]
    """The vocabulary, in the order of the probabilities."""

    touchable: bool
    """Whether touches and other orders are taken from the page."""

    skins: tuple[str, ...] = ()
    """Skins that can be chosen instead; the first is on."""

    is_arm: bool = False
    """Whether an arm's state is told."""

    compares: bool = False
    """Whether recognisers are compared, in place of all else beside the scene."""


TouchKind = Literal["poke", "double_pat", "grab", "begin", "move", "end"]
PageKind = Literal[
    "pause_task",
    "resume_task",
    "unplug",
    "plug",
    "kill",
    "restore",
    "skin",
    "record",
    "stop_recording",
]


@dataclass(frozen=True)
class TouchOrder:
    """A finger or hand that is to touch the simulated skin."""

    kind: TouchKind
    """`begin`, `move` and `end` are of a finger that is dragged over the skin."""

    link: str
    """Link of the taxel that was pointed at."""

    p_link: tuple[float, float, float]
    """The point on the skin, in the frame of the link [m]."""

    force: float
    """How hard [N]."""

    seconds: float
    """How long; without meaning for a finger that is dragged [s]."""

    key: int
    """Tells touches apart: `begin`, `move` and `end` of one finger share it."""


@dataclass(frozen=True)
class PageOrder:
    """Something else that a person asked for."""

    kind: PageKind
    """What to do."""

    value: str | float | None = None
    """With what: a patch to pull or plug in, the share of taxels to kill, a skin."""


Order = TouchOrder | PageOrder

Word = Literal["ready", "refused", "shown", "order"]
READY: Word = "ready"
"""The page is served; the value is its port."""
REFUSED: Word = "refused"
"""It cannot be served; the value says why."""
SHOWN: Word = "shown"
"""A picture has been shown: another may come."""
ORDER: Word = "order"
"""A person ordered something."""
