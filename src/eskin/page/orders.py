"""What people do in the page, as the main process is told of it."""

from dataclasses import dataclass
from typing import Literal

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
