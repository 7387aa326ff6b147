"""Clip generators make clips from their plans."""

from abc import ABC, abstractmethod
from typing import final

from eskin.errors import GenerationError
from eskin.robot import load_robot
from eskin.sim.constants import Constants, load_constants
from eskin.sim.dataset.clip import SimulatedClip, get_build, make_clip
from eskin.sim.dataset.pairs import make_pair_clip
from eskin.sim.dataset.plan import SOURCE_SKINS, BuildOrigin, ClipPlan
from eskin.sim.scene.environment import build_environment
from eskin.skin import SKIN_PRESETS, MountedSkin
from eskin.touch import Calibration


class ClipGenerator(ABC):
    """Makes clips of one skin; the same plan gives the same clip every time."""

    mounted: MountedSkin
    """The skin on its robot."""
    robot_name: str
    """What `load_robot` calls the robot."""

    @abstractmethod
    def make(self, plan: ClipPlan) -> SimulatedClip:
        """The clip of a plan, or the stream where the plan names no gesture."""

    @abstractmethod
    def calibration(self, build: BuildOrigin) -> Calibration:
        """What the user of a build knows of it."""


def mount_preset(skin: str) -> MountedSkin:
    """A preset skin on its robot."""
    preset = SKIN_PRESETS[skin]
    return MountedSkin(preset.build(), load_robot(preset.robot))


@final
class Simulator(ClipGenerator):
    """Simulates people who touch a skin that comes with eskin."""

    def __init__(self, skin: str = "ur5", constants: Constants | None = None) -> None:
        """Prepare the skin.

        Args:
            skin: name of a preset.
            constants: numbers of the world; those published unless given.

        Raises:
            GenerationError: there is no preset of that name.
        """
        if skin not in SKIN_PRESETS:
            raise GenerationError(
                f"no skin '{skin}' to simulate; allowed are {', '.join(SKIN_PRESETS)}"
            )
        self.robot_name = SKIN_PRESETS[skin].robot
        self.mounted = mounted = mount_preset(skin)
        if skin in SOURCE_SKINS:
            mounted = mount_preset(SOURCE_SKINS[skin])
        self.env = build_environment(mounted, constants or load_constants())

    def make(self, plan: ClipPlan) -> SimulatedClip:
        """The clip of a plan, or the stream where the plan names no gesture."""
        if plan.pair is not None:
            return make_pair_clip(plan, self.env)
        return make_clip(plan, self.env)

    def calibration(self, build: BuildOrigin) -> Calibration:
        """What the user of a build knows of it."""
        return get_build(build, self.env).calibration(self.mounted.skin)
