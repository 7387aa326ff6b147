"""This module tracks which skin module is at which address, and counts packets by outcome."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, final, get_args

import numpy as np

from eskin.drivers.events import EventKind, EventLog
from eskin.drivers.packet import Hello
from eskin.errors import SkinError
from eskin.skin import Patch, Skin
from eskin.touch import CalibrationConfig
from eskin.units import NS_PER_S

PacketOutcome = Literal[
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
class PacketCounts:
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
        self.counts: dict[PacketOutcome, int] = dict.fromkeys(
            get_args(PacketOutcome), 0
        )

    def add(self, fate: PacketOutcome, packets: int = 1) -> None:
        """Packets came that have a fate."""
        self.counts[fate] += packets

    def move(self, fate: PacketOutcome, packets: int) -> None:
        """Packets that waited have their fate now."""
        self.counts["waiting"] -= packets
        self.counts[fate] += packets


SILENT = NS_PER_S // 2
"""After how long unheard a patch is taken to be gone [ns]."""
SILENT_SCANS = 4
"""The same in scans of a slow patch."""
ALONE = 3 * NS_PER_S
"""How long only one module must be heard until it is believed again [ns]."""
REORDERED = NS_PER_S // 20
"""How long after another module began the first must be heard to be alive [ns]."""
HOLD_TIME = round((CalibrationConfig().silence_seconds + 0.5) * NS_PER_S)
"""How long a module is held back that takes the place of another [ns]: then the
calibrator, which has not heard its taxels for so long, tares them anew."""
MOST_CLAIMS = 8

Say = Callable[[int, EventKind, str, str | None], None]


@dataclass
class ModuleClaim:
    """A module that says that it is at an address."""

    serial_number: int
    """Of the module."""
    port: str
    """Port or network address that it is heard at."""
    fits: bool
    """Whether it is of this patch's shape."""
    first: int
    """When it was first heard [ns]."""
    heard: int
    """When it was last heard [ns]."""
    greeted: int
    """When its last hello was heard [ns]."""
    device_time: int
    """Its clock at its last hello [us], modulo 2**32."""
    rate: int
    """Scans a second that it means to make."""

    @property
    def name(self) -> str:
        """As people read it."""
        return f"module {self.serial_number:016x} at {self.port}"


@final
class AddressSlot:
    """Believes one module at an address, or none where it cannot tell two apart.

    Attributes:
        port: where data is believed from; None while none is.
        holder: the module that has the address.
        hold_until: before this time its data is not used [ns].
        disputed: whether more than one module claims the address.
        silent: whether no scans of the holder come.
    """

    def __init__(self, patch: Patch, taxels: int, say: Say) -> None:
        """Start without a module, for a patch with that many taxels."""
        self.patch = patch
        self.taxels = taxels
        self.tell = say
        self.claims: dict[tuple[int, str], ModuleClaim] = {}
        self.module: ModuleClaim | None = None
        self.port: str | None = None
        self.hold_until = 0
        self.disputed = False
        self.announced = False
        self.silent = False
        self.data_at = 0
        self.known_serial: int | None = None
        self.used_at = 0

    def say(self, stamp: int, kind: EventKind, text: str) -> None:
        """Something happened to this patch."""
        self.tell(stamp, kind, f"patch '{self.patch.id}': {text}", self.patch.id)

    def fits(self, hello: Hello) -> bool:
        """Whether the module has the rows, columns and taxels of the patch."""
        got = (hello.rows, hello.columns, hello.taxels)
        return got == (self.patch.rows, self.patch.columns, self.taxels)

    def greet(self, hello: Hello, arrived: int, port: str) -> bool:
        """Hear a hello; whether the address has another module from now on."""
        changed = self.expire(arrived)
        key = (hello.serial_number, port)
        claim = self.claims.get(key)
        if claim is not None:
            self.greet_again(claim, hello, arrived)
            return changed
        claim = ModuleClaim(
            hello.serial_number,
            port,
            self.fits(hello),
            arrived,
            arrived,
            arrived,
            hello.device_time,
            hello.rate,
        )
        if not claim.fits:
            self.say(arrived, "misfit", self.misfit_text(claim, hello))
        holder = self.module
        if holder is None or (not self.disputed and self.gone(arrived)):
            self.claims = {key: claim}
            return self.slot(claim, arrived) or changed
        if len(self.claims) < MOST_CLAIMS:
            self.claims[key] = claim
            self.disputed, self.port = True, None
        return changed

    def greet_again(self, claim: ModuleClaim, hello: Hello, arrived: int) -> None:
        """Hear one more hello of a module; its program may be another by now."""
        fits = self.fits(hello)
        other, claim.fits = fits != claim.fits, fits
        claim.heard = claim.greeted = arrived
        claim.device_time, claim.rate = hello.device_time, hello.rate
        self.check_conflict(arrived)
        if not other:
            return
        if not fits:
            self.say(arrived, "misfit", self.misfit_text(claim, hello))
        if claim is self.module and not self.disputed:
            self.slot(claim, arrived)
            if fits:
                self.say(arrived, "returned", f"{claim.name} is of this skin now")

    def misfit_text(self, claim: ModuleClaim, hello: Hello) -> str:
        """What is wrong with a module of another shape."""
        return (
            f"{claim.name} has {hello.rows} rows, {hello.columns} columns and "
            f"{hello.taxels} taxels; allowed are {self.patch.rows}, "
            f"{self.patch.columns} and {self.taxels}; none of its data is used; "
            "plug in the right module or correct the skin file"
        )

    def seat(self, claim: ModuleClaim, arrived: int) -> bool:
        """Give the address to a module; whether it is another than before."""
        old, self.module = self.module, claim
        again = self.announced and old is claim
        self.disputed = self.announced = self.silent = False
        self.data_at = arrived
        self.port = claim.port if claim.fits else None
        other = self.known_serial not in (None, claim.serial_number)
        self.hold_until = self.used_at + HOLD_TIME if other else 0
        if not claim.fits:
            return old is None or old.serial_number != claim.serial_number
        if old is None:
            self.say(arrived, "appeared", f"{claim.name} is heard")
        elif old.serial_number != claim.serial_number:
            wait = max(0, self.hold_until - arrived) / NS_PER_S
            text = f"{claim.name} has taken the place of {old.name}"
            self.say(arrived, "replaced", f"{text}; it is used in {wait:.1f} s")
        elif old.port != claim.port:
            self.say(arrived, "moved", f"{claim.name} was at {old.port} before")
        elif again:
            self.say(arrived, "returned", f"{claim.name} is alone again, and used")
        return old is None or old.serial_number != claim.serial_number

    def gone(self, now: int) -> bool:
        """Whether nothing has been heard of the holder for too long."""
        return self.module is None or now - self.module.heard >= self.patience

    @property
    def patience(self) -> int:
        """How long the holder may be unheard [ns]."""
        rate = (self.module and self.module.rate) or NS_PER_S
        return max(SILENT, SILENT_SCANS * NS_PER_S // rate)

    def hear(self, arrived: int) -> None:
        """Data of the holder came, by its port and its clock."""
        self.data_at = arrived
        if self.module is not None:
            self.module.heard = arrived
        if self.silent:
            self.silent = False
            self.say(arrived, "returned", "its scans come again")

    def believe(self, arrived: int) -> None:
        """Data of the holder is used."""
        self.used_at = arrived
        if self.module is not None:
            self.known_serial = self.module.serial_number

    def overhear(self, arrived: int, port: str) -> None:
        """Data came that is not believed: whoever alone claims that port is alive."""
        claims = [claim for claim in self.claims.values() if claim.port == port]
        if self.disputed and len(claims) == 1:
            claims[0].heard = arrived
            self.check_conflict(arrived)

    def check_conflict(self, now: int) -> None:
        """Say it once when two modules are known to be alive at the same time."""
        if not self.disputed or self.announced:
            return
        began = max(claim.first for claim in self.claims.values())
        alive = [c for c in self.claims.values() if c.heard >= began + REORDERED]
        if any(claim.first < began for claim in alive):
            self.announced = True
            names = " and ".join(claim.name for claim in self.claims.values())
            self.say(
                now,
                "conflict",
                f"{names} both have address {self.patch.address}; neither is used; "
                "unplug one or give it another address",
            )

    def expire(self, now: int) -> bool:
        """Forget modules that are heard no more; whether the address changed hands."""
        if not self.disputed:
            return False
        alive = {
            key: claim
            for key, claim in self.claims.items()
            if now - claim.heard < ALONE
        }
        if len(alive) > 1:
            self.claims = alive
            return False
        if not alive:
            latest = max(self.claims, key=lambda key: self.claims[key].heard)
            alive = {latest: self.claims[latest]}
        self.claims = alive
        return self.slot(next(iter(alive.values())), now)

    def poll(self, now: int) -> bool:
        """Notice who is gone; whether the address has another module from now on."""
        changed = self.expire(now)
        quiet = now - self.data_at >= self.patience
        if self.port is not None and quiet and not self.silent:
            self.silent = True
            self.say(now, "silent", "no scans come any more; check cable and power")
        return changed


MOST_RATE = 10_000
"""Scans a second that a skin may have."""
MOST_STRANGERS = 64
"""Unknown addresses that are said; more are garbage."""


@final
class ModuleRegistry:
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
        self.slots = {
            patch.address: AddressSlot(patch, int(count), log.say)
            for patch, count in zip(skin.patches, counts, strict=True)
        }
        self.strangers: set[int] = set()
        if len(self.slots) != len(skin.patches):
            raise SkinError(
                f"skin '{skin.name}' has {len(skin.patches)} patches at "
                f"{len(self.slots)} addresses; allowed is one address a patch; "
                "correct the skin file"
            )

    def greet(self, hello: Hello, arrived: int, port: str) -> AddressSlot | None:
        """Hear a hello; the seat if it has another module from now on."""
        seat = self.slots.get(hello.address)
        if seat is None:
            self.report_unknown_address(hello.address, arrived, port)
            return None
        return seat if seat.handle_hello(hello, arrived, port) else None

    def report_unknown_address(self, address: int, arrived: int, port: str) -> None:
        """Say once that an address is not of this skin."""
        if address in self.strangers or len(self.strangers) >= MOST_STRANGERS:
            return
        self.strangers.add(address)
        known = ", ".join(str(known) for known in sorted(self.slots))
        self.log.say(
            arrived,
            "misfit",
            f"address {address} at {port} is none of this skin; allowed are {known}; "
            "set the module's address or use its skin file",
        )

    def poll(self, now: int) -> list[AddressSlot]:
        """Notice who is gone; the seats that have another module from now on."""
        return [seat for seat in self.slots.values() if seat.poll(now)]

    @property
    def promised(self) -> int:
        """The highest rate that a module of this skin promises [1/s]; 0 without.

        A rate that no skin has is not believed.
        """
        holders = (seat.module for seat in self.slots.values() if seat.port)
        rates = (holder.rate for holder in holders if holder)
        return max((rate for rate in rates if rate <= MOST_RATE), default=0)
