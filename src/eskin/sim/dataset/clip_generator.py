"""Clip generators simulate clips from their plans."""

from abc import ABC, abstractmethod
from typing import final

from eskin.errors import GenerationError
from eskin.sim.constants import Constants, load_constants
from eskin.sim.dataset.clip import SimulatedClip, get_build, make_clip
from eskin.sim.dataset.pairs import simulate_pair
from eskin.sim.dataset.plan import SOURCE_SKINS, BuildOrigin, ClipPlan
from eskin.sim.scene.environment import build_environment, mount_preset
from eskin.skin import SKIN_PRESETS, MountedSkin
from eskin.touch import Calibration


class ClipGenerator(ABC):
    """A clip generator simulates clips of one skin, always the same from one plan."""

    mounted: MountedSkin
    """Skin on its robot."""
    robot_name: str
    """Name of the robot for `load_robot`."""

    @abstractmethod
    def make(self, plan: ClipPlan) -> SimulatedClip:
        """Simulate the clip of a plan, or the stream of a plan without gesture."""

    @abstractmethod
    def calibration(self, build: BuildOrigin) -> Calibration:
        """Return the calibration that the user of a build has."""


@final
class Simulator(ClipGenerator):
    """The simulator generates clips of people who touch a preset skin."""

    def __init__(self, skin: str = "ur5", constants: Constants | None = None) -> None:
        """Prepare the skin.

        Args:
            skin: name of a preset.
            constants: constants of the simulation; the published ones by default.

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
        """Simulate the clip of a plan, or the stream of a plan without gesture."""
        if plan.pair is not None:
            pair = simulate_pair(plan, self.env)
            return pair.second if plan.pair.is_second else pair.first
        return make_clip(plan, self.env)

    def calibration(self, build: BuildOrigin) -> Calibration:
        """Return the calibration that the user of a build has."""
        return get_build(build, self.env).calibration(self.mounted.skin)
