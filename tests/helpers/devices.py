"""A small skin, virtual patches that send its scans, and the other ends of ports."""

import socket
import threading
from contextlib import contextmanager
from functools import cache

import numpy as np
import serial

from eskin.drivers import Data, Deframer, ManualClock, decode_packet
from eskin.robot import load_robot
from eskin.sim.dataset import ClipGenerator
from eskin.sim.dataset.clip import SimulatedClip
from eskin.sim.virtual import (
    UdpPort,
    VirtualPort,
    VirtualSkin,
    parse_fault,
)
from eskin.skin import MountedSkin, Patch, Plane, TaxelGrid, build_skin
from eskin.touch import Calibration, Scan

PERIOD = 20_000_000
RATE = 50.0
PATIENCE = 10.0
"""How long a test waits for what must come [s]."""


@cache
def small_skin():
    """Build three patches on a table: the first and the last are alike."""
    sizes = {"left": (3, 4), "middle": (5, 2), "right": (3, 4)}
    laid = []
    for number, (name, (rows, columns)) in enumerate(sizes.items()):
        place = np.eye(4)
        place[0, 3] = 0.1 * number
        patch = Patch(name, "table", number + 1, rows, columns)
        laid.append((patch, TaxelGrid(rows, columns, 0.01, 0.01), Plane(place)))
    return build_skin("small", laid)


def mounted_small():
    return MountedSkin(small_skin(), load_robot("table"))


def calibration_of(skin):
    return Calibration.uniform(skin.count, 4095, 100.0)


def scans_of(skin, count, seed=0, received=None):
    """Yield scans of random counts, of a robot without joints."""
    rng = np.random.default_rng(seed)
    if received is None:
        received = np.ones(skin.count, dtype=bool)
    for number in range(count):
        counts = rng.integers(0, 4096, skin.count).astype(np.int32)
        yield Scan(PERIOD * (number + 1), counts, received, np.zeros(0))


class StillSimulator(ClipGenerator):
    """Simulates somebody who only rests, on a small skin."""

    def __init__(self, name, robot=None):
        self.robot_name = "table"
        self.mounted = mounted_small()

    def calibration(self, build):
        return calibration_of(self.mounted.skin)

    def make(self, plan):
        counts = np.full((50, self.mounted.skin.count), 7, np.int32)
        received = np.ones(counts.shape, dtype=bool)
        return SimulatedClip(counts, received, np.zeros((50, 0)), (), 0, {})


class MemoryPort(VirtualPort):
    """Keeps what is sent, in memory."""

    framed = False

    def __init__(self, framed=False):
        super().__init__()
        self.framed = framed
        self.sent = []
        self.requests = []

    @property
    def uri(self):
        return "memory:"

    def send(self, chunks):
        self.sent += chunks
        self.bytes += sum(len(chunk) for chunk in chunks)

    def receive(self):
        taken = self.requests
        self.requests = []
        return taken

    def flush(self):
        pass

    def unplug(self):
        pass

    def plug(self):
        pass

    def close(self):
        pass


def send_scans(*faults, skin=None, count=100, framed=False, scans=None):
    """Return all that a skin with faults sends, and the virtual skin."""
    skin = skin or small_skin()
    port = MemoryPort(framed)
    made = [parse_fault(text, skin, seed) for seed, text in enumerate(faults)]
    device = VirtualSkin(skin, [port], RATE, made)
    device.play(scans or scans_of(skin, count), ManualClock())
    return port.sent, device


def select_data(packets, address):
    """Return the data packets of one patch."""
    return [p for p in packets if isinstance(p, Data) and p.address == address]


@contextmanager
def playing(device, scans, clock):
    """Play scans on a virtual skin in a thread; stop and close it at the end."""
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
def open_receiver():
    """Give a UDP socket on loopback, and its port."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(PATIENCE)
        yield receiver, receiver.getsockname()[1]


def udp_skin(skin, port, **options):
    """Return a virtual skin that sends to a port on loopback."""
    return VirtualSkin(skin, [UdpPort("127.0.0.1", port)], RATE, **options)


def open_line(port):
    """Open a pseudo-terminal as the host does."""
    return serial.Serial(port.uri.removeprefix("serial:"), timeout=PATIENCE)


def read_packets(line, count):
    """Return the next packets on a line, decoded."""
    deframer = Deframer()
    found = []
    while len(found) < count:
        found += deframer.push_chunk(line.read(max(1, line.in_waiting)))
    return [decode_packet(packet) for packet in found[:count]]
