"""This module simulates a whole skin on real transports."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from typing import final

import numpy as np

from eskin.drivers.clock import Clock
from eskin.drivers.packet import (
    MAX_COUNT,
    VERSION_2,
    Request,
    decode_packet,
    encode_frame,
)
from eskin.errors import DeviceError, PacketError
from eskin.progress import Closing
from eskin.recording.records import compute_skipped
from eskin.sim.virtual.fault import (
    FOREVER,
    DeviceFault,
    LineFault,
    ModuleFault,
    OutgoingBytes,
    PacketFault,
    TaxelFault,
)
from eskin.sim.virtual.patch import MAX_RATE, VirtualPatch
from eskin.sim.virtual.ports import VirtualPort
from eskin.skin import Skin
from eskin.touch import Scan
from eskin.units import NS_PER_S

MAX_CLOCK_ERROR = 50.0
"""Largest error of a patch's clock [ppm]."""
ANSWER_INTERVAL = NS_PER_S // 1000
"""How often it is checked whether requests have arrived [ns]."""
MAX_UPTIME = 60.0
"""Longest time that a patch has run when the skin starts [s]."""


@final
class VirtualSkin(Closing):
    """Simulates all patches of a skin, each with its own clock, on one or more ports.

    A packet has the time of its scan, not the time at which it is sent: a slow receiver
    makes it late but changes nothing in it.

    Attributes:
        patches: virtual patches in the order of the skin's.
        elapsed: time from the start of the skin to its next scan [ns].
    """

    def __init__(
        self,
        skin: Skin,
        ports: Sequence[VirtualPort],
        rate: float = 50.0,
        faults: Sequence[DeviceFault] = (),
        seed: int = 0,
        version: int = VERSION_2,
        key: bytes | None = None,
    ) -> None:
        """Power up all patches.

        Args:
            skin: skin whose patches are simulated.
            ports: ports that the patches share evenly; closed with the skin.
            rate: scan rate [1/s].
            faults: faults, applied in this order.
            seed: seed of serial numbers and clocks.
            version: version of the protocol, 1 or 2.
            key: key of 32 bytes that seals packets of version 2; None for no seals.

        Raises:
            ValueError: there are no ports, more ports than patches, no rate, no such
                version, or a key for version 1.
        """
        if not 1 <= len(ports) <= len(skin.patches):
            raise ValueError(
                f"{len(ports)} ports for {len(skin.patches)} patches; allowed are 1 to "
                f"{len(skin.patches)}"
            )
        if not 0 < rate <= MAX_RATE:
            raise ValueError(
                f"rate is {rate} scans a second; allowed are above 0 to {MAX_RATE}"
            )
        if version not in (1, 2) or (version == 1 and key is not None):
            raise ValueError(
                f"version is {version}{'' if key is None else ' with a key'}; allowed "
                "are 1 and 2, and a key with 2"
            )
        self.skin = skin
        self.ports = tuple(ports)
        self.rate = rate
        self.faults = tuple(faults)
        rng = np.random.default_rng(seed)
        self.patches = tuple(
            VirtualPatch(
                patch,
                skin.find_taxels(patch.id),
                rate,
                serial_number=int(rng.integers(2**63)),
                clock_error=float(rng.uniform(-MAX_CLOCK_ERROR, MAX_CLOCK_ERROR)),
                offset=float(rng.uniform(0.0, MAX_UPTIME)),
                version=version,
                key=key,
            )
            for patch in skin.patches
        )
        patches = len(skin.patches)
        self.port_of = [index * len(ports) // patches for index in range(patches)]
        self.scans = self.packets = self.elapsed = 0
        self.is_stopped = False

    def play(
        self, scans: Iterable[Scan], clock: Clock, seconds: float | None = None
    ) -> None:
        """Send scans, each at its time; one whose time is past is sent at once.

        Args:
            scans: one for every scan that the skin makes, until they end.
            clock: clock that times the scans; with a `ManualClock` scans are sent as
                fast as the transport allows.
            seconds: duration after which to stop [s]; None plays all scans.
        """
        began: int | None = None
        end = FOREVER if seconds is None else round(seconds * NS_PER_S)
        for scan in scans:
            if self.is_stopped or self.elapsed >= end:
                break
            if began is None:
                began = clock.now() - self.elapsed
            while (left := began + self.elapsed - clock.now()) > 0:
                clock.sleep(min(left, ANSWER_INTERVAL) / NS_PER_S)
                self.answer(clock.now() - began)
            self.send(scan)
        self.transmit([], FOREVER)
        for port in self.ports:
            port.flush()

    def stop(self) -> None:
        """Stop `play` before its next scan; any thread may call this."""
        self.is_stopped = True

    def send(self, scan: Scan) -> None:
        """Build the packets of one scan and send them through all faults."""
        self.check_scan(scan)
        at = self.elapsed
        counts = scan.counts
        is_hello_due = self.scans % max(1, round(self.rate)) == 0
        for fault in self.faults:
            if isinstance(fault, ModuleFault):
                fault.change(self.patches, at)
            elif isinstance(fault, TaxelFault) and fault.is_active(at):
                counts = counts.copy()
                part = fault.spec.taxels
                counts[part] = fault.disturb(counts[part])
                fault.count += len(part)
        packets: list[OutgoingBytes] = []
        for index, patch in enumerate(self.patches):
            if patch.absences == 0:
                made = (
                    patch.build_hello_and_status(at)
                    if is_hello_due or patch.is_new
                    else []
                )
                made += patch.measure(counts, scan.received, at)
                packets += [OutgoingBytes(index, data) for data in made]
        self.packets += len(packets)
        self.scans += 1
        self.elapsed = round(self.scans * NS_PER_S / self.rate)
        self.update_ports()
        self.transmit(packets, at)

    def answer(self, at: int) -> None:
        """Answer the requests that have arrived, through all faults."""
        packets: list[OutgoingBytes] = []
        for number, port in enumerate(self.ports):
            for data in port.receive():
                with suppress(PacketError):
                    packets += self.build_answers(number, data, at)
        if packets:
            self.packets += len(packets)
            self.transmit(packets, at)

    def build_answers(self, port: int, data: bytes, at: int) -> list[OutgoingBytes]:
        """Return what the patches at a port answer to a packet of the host.

        Raises:
            PacketError: it is no packet.
        """
        request = decode_packet(data)
        if not isinstance(request, Request):
            return []
        return [
            OutgoingBytes(index, answer)
            for index, patch in enumerate(self.patches)
            if self.port_of[index] == port and patch.absences == 0
            if patch.address == request.address
            for answer in patch.answer(request, data, at)
        ]

    def check_scan(self, scan: Scan) -> None:
        """Raise a DeviceError if a scan does not fit the skin or the protocol."""
        if len(scan.counts) != self.skin.count:
            raise DeviceError(
                f"scan has {len(scan.counts)} counts, skin '{self.skin.name}' has "
                f"{self.skin.count} taxels; play what was recorded with this skin"
            )
        sent = scan.counts if scan.received.all() else scan.counts[scan.received]
        if len(sent) and not 0 <= sent.min() <= sent.max() <= MAX_COUNT:
            raise DeviceError(
                f"counts are {sent.min()} to {sent.max()}; allowed by the protocol are "
                f"0 to {MAX_COUNT}; play a recording with fewer bits"
            )

    def update_ports(self) -> None:
        """Unplug the ports whose patches are all away, and plug in the others."""
        patches = zip(self.patches, self.port_of, strict=True)
        present = {number for patch, number in patches if patch.absences == 0}
        for number, port in enumerate(self.ports):
            if number in present:
                port.plug()
            else:
                port.unplug()

    def transmit(self, packets: list[OutgoingBytes], at: int) -> None:
        """Send packets through the faults of packets and lines."""
        for fault in self.faults:
            if isinstance(fault, PacketFault):
                packets = fault.transmit(packets, at)
        chunks = [
            OutgoingBytes(packet.patch, encode_frame(packet.data))
            if self.ports[self.port_of[packet.patch]].framed
            else packet
            for packet in packets
        ]
        for fault in self.faults:
            if isinstance(fault, LineFault):
                chunks = fault.transmit(chunks, at)
        for number, port in enumerate(self.ports):
            own = [data for patch, data in chunks if self.port_of[patch] == number]
            if own:
                port.send(own)

    def counters(self) -> dict[str, object]:
        """Return scans and packets built, bytes sent, packets undelivered, faults."""
        return {
            "scans": self.scans,
            "packets": self.packets,
            "bytes": sum(port.bytes for port in self.ports),
            "unheard": sum(port.undelivered for port in self.ports),
            "faults": [fault.counters() for fault in self.faults],
        }

    def close(self) -> None:
        """Close all ports; may be called twice."""
        for port in self.ports:
            port.close()


def resample_scans(scans: Iterable[Scan], rate: float) -> Iterator[Scan]:
    """Yield the latest scan at every tick of another rate; the duration stays the same.

    A scan is repeated where the rate is higher, and may be left out where it is lower.
    The first tick is at the first scan; `rate` is in [1/s]. A gap lasts 10 s at most.
    """
    period = round(NS_PER_S / rate)
    latest: Scan | None = None
    start = ticks = 0
    for scan in scans:
        if latest is None:
            start = scan.stamp
        else:
            start += compute_skipped(scan.stamp - latest.stamp, period)
            while start + round(ticks * NS_PER_S / rate) < scan.stamp:
                yield latest
                ticks += 1
        latest = scan
    if latest is not None:
        yield latest
