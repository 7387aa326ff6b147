"""A small skin on a cable: virtual patches, and somebody who listens to them."""

import socket
import threading
from contextlib import contextmanager

import numpy as np
import serial

from eskin.drivers import Deframer, ManualClock, decode_packet
from eskin.drivers.virtual import (
    PtyPort,
    UdpPort,
    VirtualPort,
    VirtualSkin,
    parse_fault,
)
from eskin.skin import Patch, Plane, TaxelGrid, build_skin
from eskin.touch import Scan

PERIOD = 20_000_000
RATE = 50.0
PATIENCE = 10.0
"""How long a test waits for what must come [s]."""


def small_skin():
    """Three patches on a table: the first and the last are alike, the second is not."""
    sizes = {"left": (3, 4), "middle": (5, 2), "right": (3, 4)}
    laid = []
    for number, (name, (rows, columns)) in enumerate(sizes.items()):
        place = np.eye(4)
        place[0, 3] = 0.1 * number
        patch = Patch(name, "table", number + 1, rows, columns)
        laid.append((patch, TaxelGrid(rows, columns, 0.01, 0.01), Plane(place)))
    return build_skin("small", laid)


def scans_of(skin, count, seed=0, received=None):
    """Scans of any counts, of a robot without joints."""
    rng = np.random.default_rng(seed)
    if received is None:
        received = np.ones(skin.count, dtype=bool)
    for number in range(count):
        counts = rng.integers(0, 4096, skin.count).astype(np.int32)
        yield Scan(PERIOD * (number + 1), counts, received, np.zeros(0))


class Listener(VirtualPort):
    """A port that keeps what is sent, in memory."""

    framed = False

    def __init__(self, framed=False):
        super().__init__()
        self.framed = framed
        self.heard = []
        self.plugged = True
        self.closed = False

    @property
    def uri(self):
        return "memory:"

    def send(self, chunks):
        self.heard += chunks
        self.bytes += sum(len(chunk) for chunk in chunks)

    def flush(self):
        pass

    def unplug(self):
        self.plugged = False

    def plug(self):
        self.plugged = True

    def close(self):
        self.closed = True


def heard_with(*faults, skin=None, count=100, ports=1, framed=False, scans=None):
    """All that a skin with faults says, and the skin, which was played to its end."""
    skin = skin or small_skin()
    listeners = [Listener(framed) for _ in range(ports)]
    made = [parse_fault(text, skin, seed) for seed, text in enumerate(faults)]
    device = VirtualSkin(skin, listeners, RATE, made)
    device.play(scans or scans_of(skin, count), ManualClock())
    return [data for port in listeners for data in port.heard], device


@contextmanager
def playing(device, scans, clock):
    """A virtual skin that plays in a thread; stopped and closed at the end."""
    failed = []

    def play():
        try:
            device.play(scans, clock)
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=play)
    with device:
        thread.start()
        try:
            yield device
        finally:
            device.stop()
            thread.join(PATIENCE)
    assert not thread.is_alive()
    assert not failed


@contextmanager
def listening():
    """A UDP socket on loopback and the port to give to `UdpPort`."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as heard:
        heard.bind(("127.0.0.1", 0))
        heard.settimeout(PATIENCE)
        yield heard, heard.getsockname()[1]


def udp_skin(skin, port, **options):
    """A virtual skin that sends to a port on loopback."""
    return VirtualSkin(skin, [UdpPort("127.0.0.1", port)], RATE, **options)


def pty_skin(skin, **options):
    """A virtual skin on one pseudo-terminal."""
    return VirtualSkin(skin, [PtyPort()], RATE, **options)


@contextmanager
def opened(port):
    """A pseudo-terminal as the host opens it."""
    with serial.Serial(port.uri.removeprefix("serial:"), timeout=PATIENCE) as line:
        yield line


def read_packets(line, count):
    """The next packets on a line, decoded."""
    deframer, found = Deframer(), []
    while len(found) < count:
        found += deframer.push(line.read(max(1, line.in_waiting)))
    return [decode_packet(packet) for packet in found[:count]]
