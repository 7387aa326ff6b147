"""A skin in another process that sends touches, as fast as it is told.

python -m eskin.bench.sender RATE SKIN [UDP_PORT]

Without a port it sends over a pseudo-terminal. It says where, then sends until it is
killed.
"""

import sys
from collections.abc import Iterator
from itertools import count

import numpy as np
from jaxtyping import Int

from eskin.bench.scene import Scene, on_forearm, on_upper_arm, round_forearm
from eskin.drivers import HostClock
from eskin.drivers.virtual import PtyPort, UdpPort, VirtualSkin
from eskin.robot import load_robot
from eskin.skin import MountedSkin, load_skin
from eskin.touch import Calibration, Scan

SMOOTH = 1000.0
"""Different scans a second; at another rate some come twice, or are left out."""
REST = 100
"""Counts of an untouched taxel."""
ACTIVE = 60
"""Taxels of each touch."""


def calibration_of(taxels: int) -> Calibration:
    """Of the electronics that the touches are sent through."""
    return Calibration.uniform(taxels, 4095, 100.0)


def touch_counts(mounted: MountedSkin) -> Int[np.ndarray, "scan taxel"]:
    """Counts of three touches, one after the other, each 1.5 s long, then 0.6 s none.

    Args:
        mounted: the ur5's skin on its robot.
    """
    skin = mounted.skin
    touches = [f(skin, ACTIVE) for f in (on_forearm, on_upper_arm, round_forearm)]
    scale = 1.0 / calibration_of(skin.count).gain
    rng = np.random.default_rng(0)
    rows = []
    for touch in touches:
        scene = Scene(mounted, touch, SMOOTH)
        for instant in scene.instants(scene.touched + scene.lifted):
            noise = rng.normal(REST, 1.0, skin.count)
            rows.append(np.rint(instant.reading.pressure * scale + noise))
    return np.array(rows, np.int32)


def endless(counts: Int[np.ndarray, "scan taxel"], rate: float) -> Iterator[Scan]:
    """The same again and again, as so many scans a second as are asked for."""
    received, q = np.ones(counts.shape[1], bool), np.zeros(0)
    for number in count():
        seconds = number / rate
        row = counts[int(seconds * SMOOTH) % len(counts)]
        yield Scan(round(seconds * 1e9), row, received, q)


def main() -> None:
    """Send until killed."""
    rate, name, *port = sys.argv[1:]
    skin = load_skin(name)
    counts = touch_counts(MountedSkin(skin, load_robot(name)))
    line = UdpPort("127.0.0.1", int(port[0])) if port else PtyPort()
    with VirtualSkin(skin, [line], float(rate)) as device:
        sys.stdout.write(f"{line.uri}\n")
        sys.stdout.flush()
        device.play(endless(counts, float(rate)), HostClock())


if __name__ == "__main__":
    main()
