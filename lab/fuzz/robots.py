"""Fuzz the readers of URDFs and of command maps."""

import random
from pathlib import Path
from typing import final

import numpy as np
import yaml

from eskin.command import load_commands, parse_commands
from eskin.errors import CommandError, RobotError
from eskin.robot import Kinematics, Robot, load_urdf
from eskin.robot.presets import read_preset_urdf
from eskin.skin import load_skin
from lab.fuzz.mutation import mutate
from lab.fuzz.run import Target, check_refusal
from lab.fuzz.skin_files import YAML_WORDS

VOCABULARY = ("none", "double_pat", "grab", "poke", "stroke")
MAP_WORDS = (
    *YAML_WORDS,
    b"gesture: ",
    b"action: ",
    b"function: ",
    b"link: ",
    b"patch: ",
    b"poke",
    b"confidence: ",
    b"cool_down: ",
    b"none",
    b"resume",
    b"hold",
    b"commands:\n",
    b"os.system",
    b"__import__",
    b"eval",
    b"0.5",
    b"-1",
    b"{}",
    b"[]",
    b"null",
)


@final
class CommandsTarget(Target):
    """Fuzzes the reader of command maps."""

    def __init__(self, folder: Path) -> None:
        """Start from a map with every key; the inputs are written into the folder."""
        self.path = folder / "commands.yaml"
        self.skin = load_skin("ur5")
        patch = self.skin.patches[0]
        rules = [
            {"gesture": "poke", "action": "toggle_pause", "cool_down": 1.0},
            {"gesture": "grab", "action": "open_gripper", "confidence": 0.9},
            {"gesture": "stroke", "action": "slow", "link": patch.link},
            {"gesture": "stroke", "action": "normal", "patch": patch.id},
        ]
        text = yaml.safe_dump({"version": 1, "commands": rules}, sort_keys=False)
        self.whole = text.encode()

    def make(self, rng: random.Random) -> bytes:
        """Return the mutated map."""
        return mutate(self.whole, rng, MAP_WORDS)

    def feed(self, data: bytes) -> bool:
        """Load the map; an accepted map must survive writing and reading."""
        self.path.write_bytes(data)
        try:
            commands = load_commands(self.path, VOCABULARY, self.skin)
        except CommandError as error:
            check_refusal(error)
            return False
        text = yaml.safe_dump(commands.model_dump(), allow_unicode=True)
        if parse_commands(text, "again") != commands:
            raise AssertionError("the map differs after writing and reading")
        return True


def load_robot_whole(path: Path) -> Robot:
    """Load a robot, and read all its shapes.

    Raises:
        RobotError: the robot or a shape cannot be used.
    """
    robot = load_urdf(path)
    for link in robot.links:
        assert all(geom.shape is not None for geom in link.geoms)
    return robot


URDF_WORDS = (
    b"<link name='a'/>",
    b"<a>",
    b"<!DOCTYPE a>",
    b"&amp;",
    b"&#0;",
    b"<!--",
    b"nan",
    b"inf",
    b"1e999",
    b"-0",
    b"9" * 5000,
    b"<mesh filename='../a.stl'/>",
    b"continuous",
    b"fixed",
    b"floating",
    b"<mimic joint='a'/>",
    b"\0",
    b"\xff",
    b"<a>" * 2000,
    b"encoding='utf-7'",
    b"xmlns='a'",
    b"\n",
    b'"',
    b"<limit/>",
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
        return mutate(self.whole, rng, URDF_WORDS)

    def feed(self, data: bytes) -> bool:
        """Load the robot and its shapes, and compute its poses."""
        self.path.write_bytes(data)
        try:
            robot = load_robot_whole(self.path)
        except RobotError as error:
            check_refusal(error)
            return False
        poses = Kinematics(robot).poses(np.zeros(len(robot.joint_names)))
        if poses.shape != (len(robot.links), 4, 4):
            raise AssertionError("the poses are not those of the links")
        return True
