"""Whoever makes clips from their plans: the simulator, or a stand-in for tests."""

from abc import ABC, abstractmethod

from eskin.sim.clip.outcome import Clip
from eskin.sim.clip.plan import BuildOrigin, ClipPlan
from eskin.skin import MountedSkin
from eskin.touch import Calibration


class Maker(ABC):
    """Makes clips of one skin; the same plan gives the same clip every time."""

    mounted: MountedSkin
    """The skin on its robot."""
    robot_name: str
    """What `load_robot` calls the robot."""

    @abstractmethod
    def make(self, plan: ClipPlan) -> Clip:
        """The clip of a plan, or the stream where the plan names no gesture."""

    @abstractmethod
    def calibration(self, build: BuildOrigin) -> Calibration:
        """What the user of a build knows of it."""
