"""What becomes of packets: each has exactly one fate."""

from typing import Literal, final, get_args

Fate = Literal[
    "used",
    "duplicate",
    "late",
    "superseded",
    "incomplete",
    "damaged",
    "unknown",
    "foreign",
    "held",
    "hello",
    "status",
    "waiting",
]


@final
class Fates:
    """How many packets had which fate; the sum is how many came.

    Attributes:
        counts: by fate. `used`: in a scan that was given out; `duplicate`: was there
            already; `late`: its period was over, or it fits no clock; `superseded`:
            another scan of its patch stands for its period; `incomplete`: other packets
            of its scan did not come; `damaged`: wrong CRC, length or content;
            `unknown`: another version or kind; `foreign`: of an unknown address, a
            misfit, a conflict or another port; `held`: its module, clock or rate was
            not yet known, or it waits to be tared; `hello`; `status`; `waiting`: its
            scan is not yet complete or not yet given out.
    """

    def __init__(self) -> None:
        """Start without packets."""
        self.counts: dict[Fate, int] = dict.fromkeys(get_args(Fate), 0)

    def add(self, fate: Fate, packets: int = 1) -> None:
        """Packets came that have a fate."""
        self.counts[fate] += packets

    def move(self, fate: Fate, packets: int) -> None:
        """Packets that waited have their fate now."""
        self.counts["waiting"] -= packets
        self.counts[fate] += packets
