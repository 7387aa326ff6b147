"""What happens to a skin while it streams."""

from dataclasses import asdict, dataclass
from typing import Literal

from eskin.recording import EventRecord

EventKind = Literal[
    "appeared",
    "silent",
    "returned",
    "replaced",
    "moved",
    "rebooted",
    "misfit",
    "conflict",
    "slow",
    "on_rate",
    "damaged",
    "lost",
    "fault",
    "mended",
    "unrecorded",
]


@dataclass(frozen=True)
class Event:
    """Something about the skin or a part of it that people should know."""

    stamp: int
    """When it was noticed [ns since the epoch]."""

    kind: EventKind
    """What happened. `appeared`: a patch is heard for the first time; `silent`: no
    longer; `returned`: again; `replaced`: another module is at its address; `moved`: it
    is heard at another port or network address; `rebooted`: its clock began anew;
    `misfit`: it is not of this skin; `conflict`: two modules share an address; `slow`:
    fewer scans come than it promises; `on_rate`: as many again; `damaged`: packets
    arrive broken; `lost`: scans do not arrive; `fault`: something of the skin is out of
    order; `mended`: no longer; `unrecorded`: recording has stopped, the rest goes
    on."""

    text: str
    """The same as a sentence, with what to do where there is something."""

    patch: str | None = None
    """Its patch, where it is of one."""

    row: int | None = None
    """Row in its patch, where it is of a row or taxel."""

    column: int | None = None
    """Column in its patch, where it is of a column or taxel."""

    taxel: int | None = None
    """Index in the skin, where it is of one taxel."""

    def record(self) -> EventRecord:
        """As a recording keeps it."""
        return EventRecord(**asdict(self))
