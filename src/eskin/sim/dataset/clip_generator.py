"""Clip generators simulate clips from their plans."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

from eskin.sim.constants import Constants
from eskin.sim.dataset.clip import SimulatedClip, get_build, make_clip
from eskin.sim.dataset.pairs import simulate_pair
from eskin.sim.dataset.plan import SOURCE_SKINS, BuildOrigin, ClipPlan
from eskin.sim.scene.environment import (
    build_environment,
    describe_wearer,
    load_environment,
    mount_skin,
)
from eskin.skin import MountedSkin
from eskin.touch import Calibration


class ClipGenerator(ABC):
    """A clip generator simulates clips of one skin, always the same from one plan."""

    mounted: MountedSkin
    """Skin on its robot."""
    robot_name: str
    """Name of the robot for `load_recorded_robot`."""
    urdf: bytes = b""
    """URDF of the robot; empty for one that comes with eskin."""

    @abstractmethod
    def make(self, plan: ClipPlan) -> SimulatedClip:
        """Simulate the clip of a plan, or the stream of a plan without gesture."""

    @abstractmethod
    def calibration(self, build: BuildOrigin) -> Calibration:
        """Return the calibration that the user of a build has."""


@final
class Simulator(ClipGenerator):
    """The simulator generates clips of people who touch a skin."""

    def __init__(
        self,
        skin: str = "ur5",
        constants: Constants | None = None,
        robot: str | None = None,
    ) -> None:
        """Prepare the skin.

        Args:
            skin: name of a preset, or folder of a skin.
            constants: constants of the simulation; the published ones by default.
            robot: name of a robot, or path of a URDF; None for that of a preset.

        Raises:
            SkinError: there is no such skin.
            SkinMismatchError: the robot of the skin is not known, or lacks its links.
        """
        source = SOURCE_SKINS.get(skin, skin)
        if constants is None:
            self.env = load_environment(source, robot)
        else:
            self.env = build_environment(mount_skin(source, robot), constants)
        self.mounted = self.env.mounted if source == skin else mount_skin(skin, robot)
        wearer = describe_wearer(skin, robot, self.mounted)
        self.robot_name, self.urdf = wearer.name, wearer.urdf

    def make(self, plan: ClipPlan) -> SimulatedClip:
        """Simulate the clip of a plan, or the stream of a plan without gesture."""
        if plan.pair is not None:
            pair = simulate_pair(plan, self.env)
            return pair.second if plan.pair.is_second else pair.first
        return make_clip(plan, self.env)

    def calibration(self, build: BuildOrigin) -> Calibration:
        """Return the calibration that the user of a build has."""
        return get_build(build, self.env).calibration(self.mounted.skin)


@dataclass(frozen=True)
class SimulatorFactory:
    """This factory builds the simulator of a robot's skin, in any process."""

    robot: str | None = None
    """Name of the robot, or path of its URDF; None for those of presets."""

    def __call__(self, skin: str) -> Simulator:
        """Build the simulator of a skin."""
        return Simulator(skin, robot=self.robot)
