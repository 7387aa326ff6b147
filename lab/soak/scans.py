"""Build scans of the idle ur5 skin."""

from collections.abc import Iterator

import numpy as np

from eskin.drivers import PlayedSource, SourceInfo
from eskin.robot import load_robot
from eskin.skin import load_skin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S


def idle_source(rate: float, scans: int | None = None) -> PlayedSource:
    """Build a source of the idle ur5 skin in real time: noise and moving joints.

    Args:
        rate: rate of the scans [1/s].
        scans: number of scans; without end if None.
    """
    skin, robot = load_skin("ur5"), load_robot("ur5")
    calibration = Calibration.uniform(skin.count, 4095, 100.0)
    names = tuple(robot.joint_names)
    info = SourceInfo("sim:ur5", "ur5", names, skin, calibration, rate)
    played = idle_scans(skin.count, len(names), rate, scans)
    return PlayedSource(info, played, restamp=True)


def idle_scans(
    taxels: int, joints: int, rate: float, scans: int | None
) -> Iterator[Scan]:
    """Yield noise of a few counts about 40, which compresses badly."""
    rng = np.random.default_rng(0)
    received = np.ones(taxels, bool)
    number = 0
    while scans is None or number < scans:
        stamp = round((number + 1) * NS_PER_S / rate)
        q = np.sin(np.arange(joints) + number / rate)
        counts = rng.integers(36, 45, taxels, dtype=np.int32)
        yield Scan(stamp, counts, received, q)
        number += 1
