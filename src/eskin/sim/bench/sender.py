"""This program simulates a skin that sends touches at a given rate.

python -m eskin.sim.bench.sender RATE SKIN [UDP_PORT]

Without a port it sends over a pseudo-terminal. It prints its address, then sends until
it is killed.
"""

import sys
from collections.abc import Iterator
from itertools import count

import numpy as np
from jaxtyping import Int

from eskin.drivers import HostClock
from eskin.robot import load_robot
from eskin.sim.bench.scene import BenchScene, find_central_taxels, find_forearm_band
from eskin.sim.virtual import PtyPort, UdpPort, VirtualSkin
from eskin.skin import MountedSkin, load_skin
from eskin.touch import Calibration, Scan

SCAN_RATE = 1000.0
"""Rate of different scans [1/s]; at another rate some are repeated or left out."""
REST = 100
"""Counts of an untouched taxel."""
ACTIVE = 60
"""Number of taxels of each touch."""


def build_sender_calibration(taxels: int) -> Calibration:
    """Build the calibration of the electronics that send the touches."""
    return Calibration.uniform(taxels, 4095, 100.0)


def build_touch_counts(mounted: MountedSkin) -> Int[np.ndarray, "scan taxel"]:
    """Build the counts of three touches, each of 1.5 s and then 0.6 s without touch."""
    skin = mounted.skin
    touches = [
        find_central_taxels(skin, "forearm_front", ACTIVE),
        find_central_taxels(skin, "upper_arm_front", ACTIVE),
        find_forearm_band(skin, ACTIVE),
    ]
    scale = 1.0 / build_sender_calibration(skin.count).gain
    rng = np.random.default_rng(0)
    rows = []
    for touch in touches:
        scene = BenchScene(mounted, touch, SCAN_RATE)
        for instant in scene.next_readings(scene.touched + scene.lifted):
            noise = rng.normal(REST, 1.0, skin.count)
            rows.append(np.rint(instant.reading.pressure * scale + noise))
    return np.array(rows, np.int32)


def repeat_scans(counts: Int[np.ndarray, "scan taxel"], rate: float) -> Iterator[Scan]:
    """Repeat the same scans without end at a rate [1/s]."""
    received = np.ones(counts.shape[1], bool)
    q = np.zeros(0)
    for number in count():
        seconds = number / rate
        row = counts[int(seconds * SCAN_RATE) % len(counts)]
        yield Scan(round(seconds * 1e9), row, received, q)


def main() -> None:
    """Send until the process is killed."""
    rate, name, *port = sys.argv[1:]
    skin = load_skin(name)
    counts = build_touch_counts(MountedSkin(skin, load_robot(name)))
    line = UdpPort("127.0.0.1", int(port[0])) if port else PtyPort()
    with VirtualSkin(skin, [line], float(rate)) as device:
        sys.stdout.write(f"{line.uri}\n")
        sys.stdout.flush()
        device.play(repeat_scans(counts, float(rate)), HostClock())


if __name__ == "__main__":
    main()
