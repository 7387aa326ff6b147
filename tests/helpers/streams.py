"""Short streams on a small skin, and a listener that keeps what it gets."""

import threading
from pathlib import Path

import numpy as np

from eskin.drivers import STEPPED, ManualClock, PlayedSource, SourceInfo
from eskin.recording import Metadata
from eskin.robot.urdf import parse_urdf
from eskin.skin import MountedSkin, build_grid_skin
from eskin.stream import Listener
from eskin.touch import Calibration, Scan

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
SKIN = build_grid_skin(3, 4, name="square")
JOINTS = ("shoulder", "elbow")
URDF = b"""<robot name="elbow">
  <link name="base"/><link name="upper"/><link name="table"/>
  <joint name="shoulder" type="continuous">
    <parent link="base"/><child link="upper"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/><child link="table"/>
  </joint>
</robot>"""
"""URDF of a robot with these joints, whose last link wears the skin."""
METADATA = Metadata("set", "P1", "morning")
INFO = SourceInfo(
    uri="sim:test",
    mounted=MountedSkin(SKIN, parse_urdf(URDF, Path("elbow.urdf"))),
    calibration=Calibration.uniform(SKIN.count, 4095, 100.0),
    rate=50.0,
)


def make_scans(count, rate=50, start=START):
    rng = np.random.default_rng(3)
    return [
        Scan(
            start + round(i * SECOND / rate),
            rng.integers(0, 4096, SKIN.count).astype(np.int32),
            rng.random(SKIN.count) < 0.9,
            rng.normal(size=len(JOINTS)),
        )
        for i in range(count)
    ]


def played(scans, pace=STEPPED, clock=None, restamp=False):
    return PlayedSource(INFO, scans, pace, clock or ManualClock(), restamp)


class Ear(Listener):
    """Keeps what it gets; what else it does is given to it."""

    def __init__(
        self, name="ear", size=1000, drop="never", message_types=(Scan,), do=None
    ):
        self.name = name
        self.size = size
        self.drop = drop
        self.message_types = message_types
        self.do = do or (lambda item: None)
        self.received = []
        self.log = None
        self.closed = 0
        self.thread = None

    def start(self, context):
        self.context = context

    def on_message(self, item):
        self.thread = threading.current_thread()
        self.do(item)
        self.received.append(item)

    def close(self):
        self.closed += 1
        if self.log is not None:
            self.log.append(self.name)


def same_scans(got, expected):
    return [scan.stamp for scan in got] == [scan.stamp for scan in expected] and all(
        np.array_equal(getattr(one, name), getattr(other, name))
        for one, other in zip(got, expected, strict=True)
        for name in ("counts", "received", "q")
    )
