"""Clip generators simulate clips of people, or of recorded people, from plans."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
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
    RecordedTouch,
    draw_recorded_touch,
    play_recorded_touch,
    read_recorded_touches,
)
from eskin.sim.scene.environment import (
    build_environment,
    load_environment,
)
from eskin.sim.scene.placement import draw_site
from eskin.skin import MountedSkin, describe_robot, mount_skin
from eskin.touch import Calibration


class ClipGenerator(ABC):
    """A clip generator simulates clips of one skin, always the same from one plan."""

    mounted: MountedSkin
    """Skin on its robot."""
    robot_name: str
    """Name of the robot, as recordings hold it."""
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
    """The simulator generates clips of people who touch a skin.

    They are drawn, or recorded ones. Where recorded people stand, and how tall they
    are, is drawn anew for each session, since the recordings do not tell.
    """

    def __init__(
        self,
        skin: str = "ur5",
        constants: Constants | None = None,
        robot: str | None = None,
        recorded: RecordedPeople | None = None,
    ) -> None:
        """Prepare the skin, and read the recorded touches if any.

        Args:
            skin: name of a preset, or folder of a skin.
            constants: constants of the simulation; the published ones by default.
            robot: name of a robot, or path of a URDF; None for the skin's own.
            recorded: people whose recorded touches are played; None draws touches.

        Raises:
            SkinError: there is no such skin.
            RobotError: the robot of the skin is not known.
            SkinMismatchError: the robot lacks links of the skin.
            ImportSourceError: the recorded touches cannot be read.
        """
        source = SOURCE_SKINS.get(skin, skin)
        if constants is None:
            self.env = load_environment(source, robot)
        else:
            self.env = build_environment(mount_skin(source, robot), constants)
        self.mounted = self.env.mounted if source == skin else mount_skin(skin, robot)
        wearer = describe_robot(self.mounted.robot)
        self.robot_name = wearer.name
        self.urdf = wearer.urdf
        self.touches = None
        if recorded is not None:
            self.touches = read_recorded_touches(recorded.folder, recorded.grouped)

    def make(self, plan: ClipPlan) -> SimulatedClip:
        """Simulate the clip of a plan, or the stream of a plan without gesture."""
        if plan.pair is not None:
            pair = simulate_pair(plan, self.env)
            return pair.second if plan.pair.is_second else pair.first
        if self.touches is None or plan.kind == IDLE:
            return make_clip(plan, self.env)
        setup = set_up_clip(plan, "", self.env, plan.rng())
        return simulate_touches(setup, (draw_played_touch(setup, self.touches),))

    def calibration(self, build: BuildOrigin) -> Calibration:
        """Return the calibration that the user of a build has."""
        return get_build(build, self.env).calibration(self.mounted.skin)


def draw_played_touch(setup: ClipSetup, touches: Sequence[RecordedTouch]) -> TrueTouch:
    """Draw the recorded touch of a clip, and its place in it.

    One that is longer than the clip begins in it, and is cut at its end.
    """
    plan = setup.plan
    env = setup.env
    rng = setup.rng
    gesture = plan.gesture or ""
    chosen = draw_recorded_touch(touches, plan.person.name, gesture, rng)
    body = get_person(Origin(plan.person.name, (*plan.session.seed, 1)), env)
    site = draw_site(env, setup.q[setup.lead], body, gesture, rng)
    touch = play_recorded_touch(chosen, site, env.constants, rng)
    start = draw_start(touch, setup.steps, env.constants, rng)
    return place_touch(setup, touch, setup.lead + start)


@dataclass(frozen=True)
class SimulatorFactory:
    """This factory builds the simulator of a robot's skin, in any process."""

    robot: str | None = None
    """Name of the robot, or path of its URDF; None for the robots of presets."""
    recorded: RecordedPeople | None = None
    """People whose recorded touches are played; None draws touches."""

    def __call__(self, skin: str) -> Simulator:
        """Build the simulator of a skin."""
        return Simulator(skin, robot=self.robot, recorded=self.recorded)
