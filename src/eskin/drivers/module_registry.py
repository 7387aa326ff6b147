"""This module tracks which skin module is at which address and port.

It also counts what became of each received packet.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, final, get_args

import numpy as np

from eskin.drivers.events import EventKind, EventLog
from eskin.drivers.packet import Hello
from eskin.errors import SkinError
from eskin.skin import Patch, Skin
from eskin.touch import SILENCE_SECONDS
from eskin.units import NS_PER_S

MAX_SCAN_RATE = 10_000
"""Highest scan rate of a skin that is accepted [1/s]."""
MAX_UNKNOWN_ADDRESSES = 64
"""Number of unknown addresses that are reported; more are taken for garbage."""
SILENCE_TIMEOUT = NS_PER_S // 2
"""Time without data after which a patch counts as silent [ns]."""
SILENCE_SCANS = 4
"""The same timeout in scans, for a slow patch."""
CONFLICT_TIMEOUT = 3 * NS_PER_S
"""Time for which only one module must send until a conflict is over [ns]."""
CONFLICT_REORDERING = NS_PER_S // 20
"""A module that sends this long after another one appeared is still there [ns]."""
HOLD_TIME = round((SILENCE_SECONDS + 0.5) * NS_PER_S)
"""Time for which the data of a replacement module is held back [ns]: after that long
without data of its taxels, the calibrator tares them again."""
MAX_CLAIMS = 8
"""Largest number of modules that are tracked at one address."""
NETWORK_PORT = "udp://"
"""Start of the names of network addresses, which anybody may claim to send from."""
AUTHENTICATED_PORT = "key:"
"""Start of the port names of modules that are known by their key."""

PacketOutcome = Literal[
    "used",
    "duplicate",
    "late",
    "superseded",
    "incomplete",
    "damaged",
    "unknown",
    "foreign",
    "unauthenticated",
    "held",
    "hello",
    "status",
    "echo",
    "waiting",
]
Report = Callable[[int, EventKind, str, str | None], None]


@final
class PacketCounts:
    """Counts packets by their outcome; the sum is how many were received.

    Attributes:
        counts: by outcome. `used`: in a scan that was emitted; `duplicate`: received
            before; `late`: its period was over, or it fits no clock; `superseded`: its
            period has another scan of the patch; `incomplete`: other packets of its
            scan did not arrive; `damaged`: wrong CRC, length or content; `unknown`:
            another version or kind; `foreign`: of an unknown address, a module of
            another shape, a conflict or another port; `unauthenticated`: without a
            valid seal where there is a key, or of no open session; `held`: its module,
            clock, rate or session was not yet known, or it waits to be tared; `hello`;
            `status`; `echo`; `waiting`: its scan is not yet complete or not yet
            emitted.
    """

    def __init__(self) -> None:
        """Start without packets."""
        outcomes: tuple[PacketOutcome, ...] = get_args(PacketOutcome)
        self.counts = dict.fromkeys(outcomes, 0)

    def count_outcome(self, outcome: PacketOutcome, packets: int = 1) -> None:
        """Count new packets under an outcome."""
        self.counts[outcome] += packets

    def settle(self, outcome: PacketOutcome, packets: int) -> None:
        """Move packets from `waiting` to their final outcome."""
        self.counts["waiting"] -= packets
        self.counts[outcome] += packets


@dataclass
class ModuleClaim:
    """A module that sends under an address, which other modules may claim as well."""

    serial_number: int
    """Serial number of the module."""
    port: str
    """Port or network address that it sends from."""
    fits: bool
    """Whether it has the shape of this patch."""
    first_seen: int
    """When the first packet arrived [ns]."""
    last_seen: int
    """When the last packet arrived [ns]."""
    hello_at: int
    """When the last hello arrived [ns]."""
    device_time: int
    """Device clock at the last hello [us], modulo 2**32."""
    rate: int
    """Nominal scan rate [1/s]; 0 where it is not specified."""

    @property
    def name(self) -> str:
        """The module as messages name it."""
        if is_authenticated(self.port):
            return f"module {self.serial_number:016x}, known by its key,"
        return f"module {self.serial_number:016x} at {self.port}"


def name_authenticated_port(serial_number: int) -> str:
    """Return the port name of a module that is known by its key, wherever it is."""
    return f"{AUTHENTICATED_PORT}{serial_number:016x}"


def is_authenticated(port: str) -> bool:
    """Return whether a port belongs to a module that is known by its key."""
    return port.startswith(AUTHENTICATED_PORT)


def is_another(claim: ModuleClaim, serial_number: int, port: str) -> bool:
    """Return whether a module may be another than the one with a serial number.

    A network does not tell who sends, and a serial number is no secret: at another
    network address it proves nothing. At another cable the module was moved.
    """
    if claim.serial_number != serial_number:
        return True
    return claim.port != port and claim.port.startswith(NETWORK_PORT)


@final
class AddressSlot:
    """Selects the one module at an address, or none where two cannot be told apart.

    Attributes:
        module: the module that has the address.
        port: port or network address whose data is accepted; None accepts none.
        hold_until: time before which its data is not used [ns].
        disputed: whether more than one module claims the address.
        silent: whether the module sends no scans.
    """

    def __init__(self, patch: Patch, taxels: int, report: Report) -> None:
        """Start without a module, for a patch with that many taxels."""
        self.patch = patch
        self.taxels = taxels
        self.report_event = report
        self.claims: dict[tuple[int, str], ModuleClaim] = {}
        self.module: ModuleClaim | None = None
        self.port: str | None = None
        self.hold_until = 0
        self.disputed = False
        self.conflict_reported = False
        self.silent = False
        self.data_at = 0
        self.known: tuple[int, str] | None = None
        self.used_at = 0

    def report(self, stamp: int, kind: EventKind, text: str) -> None:
        """Report an event of this patch."""
        text = f"patch '{self.patch.id}': {text}"
        self.report_event(stamp, kind, text, self.patch.id)

    def fits(self, hello: Hello) -> bool:
        """Return whether a module has the rows, columns and taxels of the patch."""
        got = (hello.rows, hello.columns, hello.taxels)
        return got == (self.patch.rows, self.patch.columns, self.taxels)

    def handle_hello(self, hello: Hello, arrived: int, port: str) -> bool:
        """Handle a hello; return whether another module has the address from now on."""
        changed = self.expire_claims(arrived)
        key = (hello.serial_number, port)
        claim = self.claims.get(key)
        if claim is not None:
            self.update_claim(claim, hello, arrived)
            return changed
        claim = ModuleClaim(
            serial_number=hello.serial_number,
            port=port,
            fits=self.fits(hello),
            first_seen=arrived,
            last_seen=arrived,
            hello_at=arrived,
            device_time=hello.device_time,
            rate=hello.rate,
        )
        if not claim.fits:
            self.report_misfit(claim, hello, arrived)
        if self.module is None or (not self.disputed and self.is_gone(arrived)):
            self.claims = {key: claim}
            return self.assign(claim, arrived) or changed
        if len(self.claims) < MAX_CLAIMS:
            self.claims[key] = claim
            self.disputed = True
            self.port = None
        return changed

    def update_claim(self, claim: ModuleClaim, hello: Hello, arrived: int) -> None:
        """Update a claim by another hello; its firmware may have changed."""
        fits = self.fits(hello)
        fitted = claim.fits
        claim.fits = fits
        claim.last_seen = claim.hello_at = arrived
        claim.device_time = hello.device_time
        claim.rate = hello.rate
        self.check_conflict(arrived)
        if fits == fitted:
            return
        if not fits:
            self.report_misfit(claim, hello, arrived)
        if claim is self.module and not self.disputed:
            self.assign(claim, arrived)
            if fits:
                self.report(arrived, "returned", f"{claim.name} fits this skin now")

    def report_misfit(self, claim: ModuleClaim, hello: Hello, arrived: int) -> None:
        """Report that a module has another shape than the patch."""
        self.report(
            arrived,
            "misfit",
            f"{claim.name} has {hello.rows} rows, {hello.columns} columns and "
            f"{hello.taxels} taxels; allowed are {self.patch.rows}, "
            f"{self.patch.columns} and {self.taxels}; none of its data is used; "
            "plug in the right module or correct the skin file",
        )

    def assign(self, claim: ModuleClaim, arrived: int) -> bool:
        """Give the address to a module; return whether the module has changed."""
        old = self.module
        self.module = claim
        won_conflict = self.conflict_reported and old is claim
        self.disputed = self.conflict_reported = self.silent = False
        self.data_at = arrived
        self.port = claim.port if claim.fits else None
        self.hold_until = 0
        if self.known is not None and is_another(claim, *self.known):
            self.hold_until = self.used_at + HOLD_TIME
        changed = old is None or old.serial_number != claim.serial_number
        if not claim.fits:
            return changed
        if old is None:
            self.report(arrived, "appeared", f"{claim.name} sends data")
        elif changed:
            wait = max(0, self.hold_until - arrived) / NS_PER_S
            text = f"{claim.name} has taken the place of {old.name}"
            self.report(arrived, "replaced", f"{text}; it is used in {wait:.1f} s")
        elif old.port != claim.port:
            text = f"{claim.name} was at {old.port} before"
            wait = max(0, self.hold_until - arrived) / NS_PER_S
            if wait:
                text += f", and it may be another; it is used in {wait:.1f} s"
            self.report(arrived, "moved", text)
        elif won_conflict:
            text = f"{claim.name} is the only one again and used"
            self.report(arrived, "returned", text)
        return changed

    def is_gone(self, now: int) -> bool:
        """Return whether the module has sent nothing for too long."""
        return self.module is None or now - self.module.last_seen >= self.timeout

    @property
    def timeout(self) -> int:
        """Time for which the module may send nothing [ns]."""
        rate = self.module.rate if self.module else 0
        return max(SILENCE_TIMEOUT, SILENCE_SCANS * NS_PER_S // rate if rate else 0)

    def note_data(self, arrived: int) -> None:
        """Note that data of the module arrived, from its port and by its clock."""
        self.data_at = arrived
        if self.module is not None:
            self.module.last_seen = arrived
        if self.silent:
            self.silent = False
            self.report(arrived, "returned", "its scans arrive again")

    def note_used(self, arrived: int) -> None:
        """Note that data of the module is used."""
        self.used_at = arrived
        if self.module is not None:
            self.known = (self.module.serial_number, self.module.port)

    def note_rejected_data(self, arrived: int, port: str) -> None:
        """Note unused data: where one module alone claims its port, it is there."""
        claims = [claim for claim in self.claims.values() if claim.port == port]
        if self.disputed and len(claims) == 1:
            claims[0].last_seen = arrived
            self.check_conflict(arrived)

    def check_conflict(self, now: int) -> None:
        """Report once that two modules are known to be there at the same time."""
        if not self.disputed or self.conflict_reported:
            return
        began = max(claim.first_seen for claim in self.claims.values())
        limit = began + CONFLICT_REORDERING
        alive = [claim for claim in self.claims.values() if claim.last_seen >= limit]
        if any(claim.first_seen < began for claim in alive):
            self.conflict_reported = True
            names = " and ".join(claim.name for claim in self.claims.values())
            text = f"{names} both have address {self.patch.address}; neither is used; "
            self.report(now, "conflict", text + "unplug one or change its address")

    def expire_claims(self, now: int) -> bool:
        """Drop silent claims of a conflict; return whether the module has changed."""
        if not self.disputed:
            return False
        alive = {
            key: claim
            for key, claim in self.claims.items()
            if now - claim.last_seen < CONFLICT_TIMEOUT
        }
        if len(alive) > 1:
            self.claims = alive
            return False
        if not alive:
            latest = max(self.claims, key=lambda key: self.claims[key].last_seen)
            alive = {latest: self.claims[latest]}
        self.claims = alive
        return self.assign(next(iter(alive.values())), now)

    def poll(self, now: int) -> bool:
        """Detect silence; return whether another module has the address from now on."""
        changed = self.expire_claims(now)
        quiet = now - self.data_at >= self.timeout
        if self.port is not None and quiet and not self.silent:
            self.silent = True
            text = "no scans arrive any more; check cable and power"
            self.report(now, "silent", text)
        return changed


@final
class ModuleRegistry:
    """Holds the slots of a skin's addresses and reports unknown addresses."""

    def __init__(self, skin: Skin, log: EventLog) -> None:
        """Start without modules; raise a SkinError if two patches share an address."""
        self.log = log
        counts = np.bincount(skin.patch_index, minlength=len(skin.patches))
        self.slots = {
            patch.address: AddressSlot(patch, int(count), log.log_event)
            for patch, count in zip(skin.patches, counts, strict=True)
        }
        self.unknown_addresses: set[int] = set()
        if len(self.slots) != len(skin.patches):
            raise SkinError(
                f"skin '{skin.name}' has {len(skin.patches)} patches at "
                f"{len(self.slots)} addresses; allowed is one address a patch; "
                "correct the skin file"
            )

    def handle_hello(self, hello: Hello, arrived: int, port: str) -> AddressSlot | None:
        """Handle a hello; return its slot if another module has it from now on."""
        slot = self.slots.get(hello.address)
        if slot is None:
            self.report_unknown_address(hello.address, arrived, port)
            return None
        return slot if slot.handle_hello(hello, arrived, port) else None

    def report_unknown_address(self, address: int, arrived: int, port: str) -> None:
        """Report once that no patch of this skin has an address."""
        unknown = self.unknown_addresses
        if address in unknown or len(unknown) >= MAX_UNKNOWN_ADDRESSES:
            return
        unknown.add(address)
        known = ", ".join(str(known) for known in sorted(self.slots))
        self.log.log_event(
            arrived,
            "misfit",
            f"address {address} at {port} is none of this skin; allowed are {known}; "
            "set the module's address or use its skin file",
        )

    def poll(self, now: int) -> list[AddressSlot]:
        """Detect silence; return the slots whose module has changed."""
        return [slot for slot in self.slots.values() if slot.poll(now)]

    @property
    def highest_rate(self) -> int:
        """The highest nominal rate of the skin's modules [1/s]; 0 without any.

        Rates above `MAX_SCAN_RATE` are ignored.
        """
        modules = (slot.module for slot in self.slots.values() if slot.port)
        rates = (module.rate for module in modules if module)
        return max((rate for rate in rates if rate <= MAX_SCAN_RATE), default=0)
