"""Fuzz the reader of URDFs."""

import random
from pathlib import Path
from typing import final

import numpy as np

from eskin.errors import RobotError
from eskin.robot import Kinematics, load_urdf
from eskin.robot.presets import read_preset_urdf
from lab.fuzz.mutation import mutate
from lab.fuzz.run import Target, check_refusal

WORDS = (
    *(b"<link name='a'/>", b"<a>", b"<!DOCTYPE a>", b"&amp;", b"&#0;", b"<!--"),
    *(b"nan", b"inf", b"1e999", b"-0", b"9" * 5000, b"<mesh filename='../a.stl'/>"),
    *(b"continuous", b"fixed", b"floating", b"<mimic joint='a'/>", b"\0", b"\xff"),
    *(b"<a>" * 2000, b"encoding='utf-7'", b"xmlns='a'", b"\n", b'"', b"<limit/>"),
)


@final
class RobotTarget(Target):
    """Fuzzes the reader of URDFs."""

    def __init__(self, folder: Path) -> None:
        """Start from the ur5; the inputs are written into the folder."""
        self.path = folder / "robot.urdf"
        self.whole = read_preset_urdf("ur5").encode()

    def make(self, rng: random.Random) -> bytes:
        """Return the mutated file."""
        return mutate(self.whole, rng, WORDS)

    def feed(self, data: bytes) -> bool:
        """Load the robot, and compute its poses."""
        self.path.write_bytes(data)
        try:
            robot = load_urdf(self.path)
        except RobotError as error:
            check_refusal(error)
            return False
        poses = Kinematics(robot).poses(np.zeros(len(robot.joint_names)))
        if poses.shape != (len(robot.links), 4, 4):
            raise AssertionError("the poses are not those of the links")
        return True
