"""An interactive skin simulates scans of a robot that callers move and touch."""

from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.arms import Wrench
from eskin.sim.dataset.clip import get_build
from eskin.sim.dataset.plan import BuildOrigin, Origin, build_rng, build_seed
from eskin.sim.interactive.hand import InteractiveHand
from eskin.sim.interactive.touches import MotionTrack
from eskin.sim.people.person import Person, draw_person
from eskin.sim.scene.environment import (
    SimEnvironment,
    load_environment,
)
from eskin.sim.scene.scene import (
    TouchScene,
    TrueTouchSeries,
    compute_scene_pressure,
    compute_touch_presses,
    compute_true_series,
)
from eskin.sim.sensor import Sensor, SensorBuild
from eskin.sim.sensor.build import BuildKind
from eskin.skin import Skin, describe_robot
from eskin.touch import Scan

PA_PER_KPA = 1000.0


def compute_wrenches(
    pressure: Float[np.ndarray, "active"], taxels: Int[np.ndarray, "active"], skin: Skin
) -> tuple[Wrench, ...]:
    """Compute the wrenches that pressure on taxels exerts on their links.

    Pressure acts along the inward normals; friction, and pressure outside all taxels,
    are neglected. `pressure` of each taxel is in [kPa].
    """
    forces = PA_PER_KPA * pressure * skin.areas[taxels]
    forces_link = -forces[:, None] * skin.normals[taxels]
    torques_link = np.cross(skin.positions[taxels], forces_link)
    patches = skin.patch_index[taxels]
    links = np.array(skin.link_names)[patches]
    return tuple(
        Wrench(
            str(link),
            forces_link[links == link].sum(axis=0),
            torques_link[links == link].sum(axis=0),
        )
        for link in np.unique(links)
    )


DEMO_ROLE = "demo"
"""Role of the person and build; no set has this role."""


@final
class InteractiveSkin:
    """An interactive skin simulates scans of a moving robot that is touched on request.

    Contact, film and sensor are those of simulated clips, computed one reading at a
    time, a sensor period apart. Between two scans the robot moves at constant speed.
    Jitter never samples a patch later than the end of its scan, since later motion is
    unknown.

    Attributes:
        mounted: skin on its robot.
        wearer: robot that wears it, as recordings name it.
        calibration: calibration of the sensor build.
        period: time between two scans [s].
        hand: hand that touches the skin.
        wrenches: wrenches of touches on links, means over the latest scan.
        taxel_force: sum of the normal forces on all taxels, mean over the latest scan
            [N].
    """

    def __init__(
        self,
        name: str = "ur5",
        seed: int = 0,
        build_kind: BuildKind = "fresh",
        person: Person | None = None,
        loses: bool = True,
        build: SensorBuild | None = None,
        robot: str | None = None,
    ) -> None:
        """Build a skin that is in no set that recognisers are trained or tested on.

        Args:
            name: name of a preset skin, or folder of a skin.
            seed: seed of everything that is drawn.
            build_kind: distribution that the sensor is drawn from; a build of a family
                scans at the rate nearest to its own that has whole steps.
            person: person who touches it; None draws one that is in no such set.
            loses: whether scans of patches are lost at random, as on a real skin.
            build: sensor build; None draws one of `build_kind`.
            robot: name of a robot, or path of a URDF; None for the skin's own.

        Raises:
            SkinError: there is no such skin.
            RobotError: the robot of the skin is not known.
            SkinMismatchError: the robot lacks links of the skin.
            ValueError: the seed is negative.
        """
        if seed < 0:
            raise ValueError(f"seed is {seed}; allowed are 0 and above")
        self.env = load_environment(name, robot)
        self.mounted = self.env.mounted
        constants = self.env.constants
        self.wearer = describe_robot(self.mounted.robot)
        origin = f"build {DEMO_ROLE} {build_kind}"
        build = build or get_build(
            BuildOrigin(
                f"{DEMO_ROLE}-b{seed}", build_seed(origin, 0, 0, seed), build_kind
            ),
            self.env,
        )
        self.build = round_period(build)
        skin = self.mounted.skin
        self.calibration = self.build.calibration(skin)
        self.period = self.build.electronics.period
        self.sensor = Sensor(self.build, skin, build_role_rng("sensor", seed))
        person = person or draw_demo_person(self.env, seed)
        self.hand = InteractiveHand(self.env, person, build_role_rng("hand", seed))
        delay = constants.get_constant("motion.delay").spread
        assert delay is not None
        step = constants.value("time.step")
        self.steps = round(self.period / step)
        self.track = MotionTrack(self.steps, round(delay.high / step) + 1)
        self.loses = loses
        self.unplugged = np.zeros(len(skin.patches), dtype=bool)
        self.sensitivity = self.sensor.readout.sensitivity.copy()
        self.rng = build_role_rng("kill", seed)
        self.wrenches: tuple[Wrench, ...] = ()
        self.taxel_force = 0.0

    def scan(self, stamp: int, q: Float[np.ndarray, "joint"]) -> Scan:
        """Simulate the next scan.

        `stamp` is in [ns since the epoch], `q` in [rad].

        Raises:
            ValueError: `q` does not fit the joints of the robot, or is not finite.
        """
        q = np.array(q, dtype=np.float64)
        joints = len(self.mounted.robot.joint_names)
        if q.shape != (joints,) or not np.isfinite(q).all():
            raise ValueError(
                f"q is {q}; allowed are {joints} finite numbers [rad]; give one for "
                f"each moving joint of robot '{self.mounted.robot.name}'"
            )
        span = self.track.move_to(q)
        touches = self.hand.advance(span)
        scene = TouchScene(span.q, tuple(touches.values()))
        self.press_sensor(scene, list(touches), stamp)
        counts = self.sensor.read(np.array([self.sensor.steps - 1.0]))[0]
        lost = self.sensor.losses.draw_next()[0] & self.loses
        received = ~(lost | self.unplugged)[self.mounted.skin.patch_index]
        counts[~received] = 0
        return Scan(stamp, counts, received, q)

    def press_sensor(self, scene: TouchScene, numbers: list[int], stamp: int) -> None:
        """Apply the touches of a reading to the sensor, and record their truth."""
        touch_presses = compute_touch_presses(scene, self.env)
        skin = self.mounted.skin
        pressure, taxels = compute_scene_pressure(
            touch_presses, scene.steps, self.build.film_sigma, skin
        )
        mean = pressure.mean(axis=0)
        self.wrenches = compute_wrenches(mean, taxels, skin)
        self.taxel_force = float(PA_PER_KPA * mean @ skin.areas[taxels])
        self.sensor.simulate_steps(pressure, taxels)
        truths: tuple[TrueTouchSeries, ...] = ()
        if numbers:
            truths = compute_true_series(
                scene,
                touch_presses,
                self.env.charts,
                self.mounted,
                0,
                np.array([0, self.steps]),
                self.build.electronics.step,
            )
        self.hand.set_truths(
            tuple(
                truth.to_record(numbers[truth.number], 0, stamp)
                for truth in truths
                if truth.force[0] > 0
            )
        )

    def unplug(self, patch: str) -> None:
        """Unplug the cable of a patch, so that nothing of it is received.

        Raises:
            ValueError: the skin has no such patch.
        """
        self.unplugged[self.mounted.skin.find_patches((patch,))[0]] = True

    def plug(self, patch: str) -> None:
        """Plug the cable of a patch in again.

        Raises:
            ValueError: the skin has no such patch.
        """
        self.unplugged[self.mounted.skin.find_patches((patch,))[0]] = False

    def kill(self, share: float) -> tuple[int, ...]:
        """Make a random part of the taxels dead from now on.

        The share is of all taxels; they are drawn from those that still work.

        Returns:
            Indices of the taxels.

        Raises:
            ValueError: the share is not between 0 and 1.
        """
        if not 0.0 <= share <= 1.0:
            raise ValueError(
                f"share is {share}; allowed is 0 to 1; 0.1 kills a tenth of the taxels"
            )
        alive = np.flatnonzero(self.sensor.readout.sensitivity > 0.0)
        wanted = min(round(share * self.mounted.skin.count), len(alive))
        chosen = np.sort(self.rng.choice(alive, wanted, replace=False))
        self.sensor.readout.sensitivity[chosen] = 0.0
        return tuple(chosen.tolist())

    def restore(self) -> None:
        """Restore all taxels that were killed."""
        self.sensor.readout.sensitivity[:] = self.sensitivity


def round_period(build: SensorBuild) -> SensorBuild:
    """Return a build that scans after whole steps."""
    electronics = build.electronics
    steps = max(round(electronics.period / electronics.step), 1)
    period = steps * electronics.step
    return replace(build, electronics=replace(electronics, period=period))


def build_role_rng(what: str, seed: int) -> np.random.Generator:
    """Build the random generator of one part of the simulation."""
    return build_rng(build_seed(f"{what} {DEMO_ROLE}", 0, 0, seed))


def draw_demo_person(env: SimEnvironment, seed: int) -> Person:
    """Draw a person who is in no set, such as `demo-p0`; the same for each seed."""
    origin = Origin(
        f"{DEMO_ROLE}-p{seed}", build_seed(f"person {DEMO_ROLE}", 0, 0, seed)
    )
    return draw_person(origin.name, env.constants, origin.rng())
