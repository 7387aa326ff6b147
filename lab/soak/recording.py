"""Record the idle skin and print each stamp, until the process is killed.

python -m lab.soak.recording FILE
"""

import sys
from collections.abc import Iterator
from itertools import count

import numpy as np

from eskin.drivers import PlayedSource, SourceInfo
from eskin.recording import Metadata
from eskin.robot import load_robot
from eskin.skin import MountedSkin, load_skin
from eskin.stream import Context, Listener, Message, Recorder, Stream
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

RATE = 50.0


class StampPrinter(Listener):
    """Prints the stamp of every scan."""

    name = "stamps"
    message_types = (Scan,)
    size = 1000
    drop = "never"

    def start(self, context: Context) -> None:
        """Do nothing."""

    def on_message(self, item: Message) -> None:
        """Print the stamp of a scan without delay."""
        if isinstance(item, Scan):
            print(item.stamp, flush=True)

    def close(self) -> None:
        """Do nothing."""


def idle_source() -> PlayedSource:
    """Build a source of the idle ur5 skin in real time: noise and moving joints."""
    skin = load_skin("ur5")
    robot = load_robot("ur5")
    calibration = Calibration.uniform(skin.count, 4095, 100.0)
    info = SourceInfo("sim:ur5", MountedSkin(skin, robot), calibration, RATE)
    played = idle_scans(skin.count, len(robot.joint_names))
    return PlayedSource(info, played, restamp=True)


def idle_scans(taxels: int, joints: int) -> Iterator[Scan]:
    """Yield noise of a few counts about 40, which compresses badly."""
    rng = np.random.default_rng(0)
    received = np.ones(taxels, bool)
    for number in count():
        stamp = round((number + 1) * NS_PER_S / RATE)
        q = np.sin(np.arange(joints) + number / RATE)
        counts = rng.integers(36, 45, taxels, dtype=np.int32)
        yield Scan(stamp, counts, received, q)


def main() -> None:
    """Record the idle ur5 skin."""
    listeners = (Recorder(sys.argv[1], Metadata("soak")), StampPrinter())
    with Stream(idle_source(), listeners) as stream:
        stream.wait()


if __name__ == "__main__":
    main()
