"""Which module of skin is at which address and port."""

from typing import final

import numpy as np

from eskin.drivers.event_log import EventLog
from eskin.drivers.packet import Hello
from eskin.drivers.seat import Seat
from eskin.errors import SkinError
from eskin.skin import Skin

MOST_RATE = 10_000
"""Scans a second that a skin may have."""
MOST_STRANGERS = 64
"""Unknown addresses that are said; more are garbage."""


@final
class Roster:
    """The addresses of a skin, and the modules that claim them.

    Attributes:
        seats: by address.
        log: of what happens to them.
    """

    def __init__(self, skin: Skin, log: EventLog) -> None:
        """Expect the patches of a skin; none is there yet.

        Raises:
            SkinError: two patches have the same address.
        """
        self.log = log
        counts = np.bincount(skin.patch_index, minlength=len(skin.patches))
        self.seats = {
            patch.address: Seat(patch, int(count), log.say)
            for patch, count in zip(skin.patches, counts, strict=True)
        }
        self.strangers: set[int] = set()
        if len(self.seats) != len(skin.patches):
            raise SkinError(
                f"skin '{skin.name}' has {len(skin.patches)} patches at "
                f"{len(self.seats)} addresses; allowed is one address a patch; "
                "correct the skin file"
            )

    def greet(self, hello: Hello, arrived: int, port: str) -> Seat | None:
        """Hear a hello; the seat if it has another module from now on."""
        seat = self.seats.get(hello.address)
        if seat is None:
            self.meet_stranger(hello.address, arrived, port)
            return None
        return seat if seat.greet(hello, arrived, port) else None

    def meet_stranger(self, address: int, arrived: int, port: str) -> None:
        """Say once that an address is not of this skin."""
        if address in self.strangers or len(self.strangers) >= MOST_STRANGERS:
            return
        self.strangers.add(address)
        known = ", ".join(str(known) for known in sorted(self.seats))
        self.log.say(
            arrived,
            "misfit",
            f"address {address} at {port} is none of this skin; allowed are {known}; "
            "set the module's address or use its skin file",
        )

    def poll(self, now: int) -> list[Seat]:
        """Notice who is gone; the seats that have another module from now on."""
        return [seat for seat in self.seats.values() if seat.poll(now)]

    @property
    def promised(self) -> int:
        """The highest rate that a module of this skin promises [1/s]; 0 without.

        A rate that no skin has is not believed.
        """
        holders = (seat.holder for seat in self.seats.values() if seat.port)
        rates = (holder.rate for holder in holders if holder)
        return max((rate for rate in rates if rate <= MOST_RATE), default=0)
