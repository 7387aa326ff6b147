"""Clip generators simulate clips of people, or of recorded people, from plans."""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

from eskin.sim.constants import Constants
from eskin.sim.contact.press import TrueTouch
from eskin.sim.dataset.clip import SimulatedClip, get_build, make_clip, simulate_touches
from eskin.sim.dataset.pairs import simulate_pair
from eskin.sim.dataset.plan import IDLE, BuildOrigin, ClipPlan, Origin
from eskin.sim.dataset.sets import SOURCE_SKINS
from eskin.sim.dataset.staging import (
    ClipSetup,
    draw_start,
    get_person,
    place_touch,
    set_up_clip,
)
from eskin.sim.people.recorded import (
    RecordedPeople,
    draw_recorded_touch,
    play_recorded_touch,
    read_recorded_touches,
)
from eskin.sim.scene.environment import (
    build_environment,
    describe_wearer,
    load_environment,
    mount_skin,
)
from eskin.sim.scene.placement import draw_site
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


@final
class RecordedSimulator(ClipGenerator):
    """This simulator generates clips of recorded people who touch a skin.

    Where they stand, and how tall they are, is drawn anew for each session, since the
    recordings do not tell.
    """

    def __init__(
        self,
        recorded: RecordedPeople,
        skin: str,
        constants: Constants | None = None,
        robot: str | None = None,
    ) -> None:
        """Prepare the skin, and read the recorded touches.

        Args:
            recorded: people and where their touches are.
            skin: name of a preset, or folder of a skin.
            constants: constants of the simulation; the published ones by default.
            robot: name of a robot, or path of a URDF; None for that of a preset.

        Raises:
            EskinError: there is no such skin, or its robot is not known.
            ImportSourceError: the recorded touches cannot be read.
        """
        self.simulator = Simulator(skin, constants, robot)
        self.robot_name, self.mounted = (
            self.simulator.robot_name,
            self.simulator.mounted,
        )
        self.urdf = self.simulator.urdf
        self.env = self.simulator.env
        self.touches = read_recorded_touches(recorded.folder, recorded.grouped)

    def make(self, plan: ClipPlan) -> SimulatedClip:
        """Simulate the clip of a plan."""
        if plan.kind == IDLE:
            return self.simulator.make(plan)
        setup = set_up_clip(plan, "", self.env, plan.rng())
        return simulate_touches(setup, (self.draw_touch(setup),))

    def draw_touch(self, setup: ClipSetup) -> TrueTouch:
        """Draw the recorded touch of a clip, and its place in it.

        One that is longer than the clip begins in it, and is cut at its end.
        """
        plan, rng, constants = setup.plan, setup.rng, self.env.constants
        gesture = plan.gesture or ""
        chosen = draw_recorded_touch(self.touches, plan.person.name, gesture, rng)
        body = get_person(Origin(plan.person.name, (*plan.session.seed, 1)), self.env)
        site = draw_site(self.env, setup.q[setup.lead], body, gesture, rng)
        touch = play_recorded_touch(chosen, site, constants, rng)
        start = draw_start(touch, setup.steps, constants, rng)
        return place_touch(setup, touch, setup.lead + start)

    def calibration(self, build: BuildOrigin) -> Calibration:
        """Return the calibration that the user of a build has."""
        return self.simulator.calibration(build)


@dataclass(frozen=True)
class RecordedSimulatorFactory:
    """This factory builds the simulator of recorded people, in any process."""

    recorded: RecordedPeople
    """People and where their touches are."""
    robot: str | None = None
    """Name of the robot, or path of its URDF; None for those of presets."""

    def __call__(self, skin: str) -> RecordedSimulator:
        """Build the simulator of a skin."""
        return RecordedSimulator(self.recorded, skin, robot=self.robot)
