"""The touch player simulates a person who touches a skin, as an endless source."""

import itertools
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import final

from eskin.app import SourceConfig
from eskin.drivers import Clock, PlayedSource, Source, SourceInfo
from eskin.errors import DeviceError
from eskin.registry import Driver
from eskin.robot import Robot
from eskin.sim.constants import load_constants
from eskin.sim.dataset import Simulator
from eskin.sim.dataset.clip_generator import ClipGenerator
from eskin.sim.dataset.plan import BuildOrigin, ClipPlan, Origin, Seed, build_seed
from eskin.sim.dataset.sets import get_pose_groups
from eskin.touch import Scan
from eskin.units import NS_PER_S

PLAYER_ROLE = "device"
"""Role of the person, build and session; no set has this role."""
SEGMENT_SECONDS = 15.0
"""Length of a segment, enough for the longest touch [s]."""
LEAD_SECONDS = 2.0
"""Length of the first segment, without touch, for the baseline [s]."""


@final
class TouchPlayer:
    """A touch player simulates a person on a fresh build of a skin on an arm at rest.

    Person, build and session belong to no set that recognisers are trained or tested
    on. Segments are simulated ahead in a thread. They share the pose and all constants
    of the sensor; its random walk (about one count) and creep start anew with each
    segment. Each segment begins and ends without touch.

    Attributes:
        generator: clip generator of the skin.
        build: sensor build that is touched.
        rate: scans per second [1/s].
    """

    def __init__(self, generator: ClipGenerator, seed: int = 0, start: int = 0) -> None:
        """Create a touch player.

        `start` is the stamp of the first scan [ns since the epoch].

        Raises:
            ValueError: the seed is negative.
        """
        if seed < 0:
            raise ValueError(f"seed is {seed}; allowed are 0 and above")
        constants = load_constants()
        self.generator = generator
        self.start = start
        self.seed = seed
        self.build = BuildOrigin(
            f"{PLAYER_ROLE}-b{seed}",
            build_seed(f"build {PLAYER_ROLE}", 0, 0, seed),
            "fresh",
        )
        self.groups = get_pose_groups(constants, "known", "new")
        self.difficulty = constants.value("sets.difficulty")
        self.period = round(constants.value("sensor.period") * NS_PER_S)
        self.rate = NS_PER_S / self.period

    def scans(self) -> Iterator[Scan]:
        """Yield scans without end, the same ones every time."""
        stamp = self.start
        make = self.generator.make
        plan = self.plan_segment
        with ThreadPoolExecutor(1, "player") as pool:
            pending = deque(pool.submit(make, plan(number)) for number in (0, 1))
            # Wait for the simulator's kernels to compile before the first scan.
            pending[-1].result()
            for number in itertools.count(2):
                clip = pending.popleft().result()
                pending.append(pool.submit(make, plan(number)))
                for reading in zip(clip.counts, clip.received, clip.q, strict=True):
                    yield Scan(stamp, *reading)
                    stamp += self.period

    def plan_segment(self, number: int) -> ClipPlan:
        """Plan a segment: the first without touch, the others with gestures."""

        def seed(role: str, first: int = 0) -> Seed:
            return build_seed(f"{role} {PLAYER_ROLE}", first, 0, self.seed)

        return ClipPlan(
            set_name=PLAYER_ROLE,
            seed=seed("clip", number),
            person=Origin(f"{PLAYER_ROLE}-p{self.seed}", seed("person")),
            build=self.build,
            session=Origin(f"{PLAYER_ROLE}-0000", seed("session")),
            seconds=SEGMENT_SECONDS if number else LEAD_SECONDS,
            gesture=None if number else "none",
            kind=None if number else "idle",
            groups=self.groups,
            pose=seed("pose"),
            difficulty=self.difficulty,
        )


def open_simulation(uris: Sequence[str], config: SourceConfig, clock: Clock) -> Source:
    """Open a simulation of a person in no training set, who touches without end.

    Args:
        uris: `sim:SKIN`.
        config: how it is opened.
        clock: clock that stamps the scans.

    Raises:
        DeviceError: the robot of the configuration is loaded already.
    """
    robot = config.robot
    skin = uris[0].partition(":")[2]
    if isinstance(robot, Robot):
        raise DeviceError(
            f"source sim:{skin} is given with a robot that is loaded; allowed is its "
            "name, or the path of its URDF"
        )
    simulator = Simulator(skin, robot=None if robot is None else str(robot))
    player = TouchPlayer(simulator, config.seed)
    generator = player.generator
    calibration = generator.calibration(player.build)
    info = SourceInfo(f"sim:{skin}", generator.mounted, calibration, player.rate)
    return PlayedSource(info, player.scans(), config.pace, clock, restamp=True)


DRIVER = Driver(open_simulation, "sim:SKIN", "simulated")
