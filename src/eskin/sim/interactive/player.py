"""The player simulates a person who touches a skin without end, scan by scan."""

import itertools
from collections import deque
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import final

from eskin.recording import TruthRecord
from eskin.sim.constants import load_constants
from eskin.sim.dataset.clip import SimulatedClip
from eskin.sim.dataset.clip_generator import ClipGenerator
from eskin.sim.dataset.plan import BuildOrigin, ClipPlan, Origin
from eskin.sim.dataset.session_plan import build_seed
from eskin.sim.dataset.sets import get_pose_groups
from eskin.touch import Scan
from eskin.units import NS_PER_S

PLAYER_ROLE = "device"
"""Role of its person, build and session; no set has one of that name."""
STRETCH_SECONDS = 15.0
"""Length of a stretch, enough for the longest touch [s]."""
LEAD_SECONDS = 2.0
"""Length of the first stretch, without touch, so that a baseline can be found [s]."""


@dataclass(frozen=True, eq=False)
class SampledScan:
    """A sampled scan holds one scan and the true touches during it."""

    scan: Scan
    """Scan of the sensor."""
    truths: tuple[TruthRecord, ...]
    """Every touch that presses."""


@final
class TouchPlayer:
    """A player plays one person on a fresh build of a skin, on an arm at rest.

    Neither person nor build nor session is of any set that recognisers are trained or
    tested on. Stretches are computed in a thread, ahead of what is played. All
    stretches share the pose and whatever is fixed of the sensor; its random walk, by
    about one count, and what touches leave behind begin anew with each, and each begins
    and ends without touch.

    Attributes:
        generator: clip generator of the skin.
        build: sensor that is touched.
        rate: scans per second [1/s].
    """

    def __init__(self, generator: ClipGenerator, seed: int = 0, start: int = 0) -> None:
        """Create a player.

        Args:
            generator: clip generator of a skin.
            seed: seed of everything that is drawn.
            start: stamp of the first scan [ns since the epoch].

        Raises:
            ValueError: the seed is negative.
        """
        if seed < 0:
            raise ValueError(f"seed is {seed}; allowed are 0 and above; change it")
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
        """Yield scans without end."""
        return (moment.scan for moment in self.sampled_scans())

    def sampled_scans(self) -> Iterator[SampledScan]:
        """Yield scans with their true touches without end, the same every time.

        Touches are numbered through all stretches.
        """
        touches, stamp = 0, self.start
        with ThreadPoolExecutor(1, "player") as ahead:
            coming = deque(
                ahead.submit(self.generator.make, self.plan_stretch(number))
                for number in (0, 1)
            )
            # Wait for the simulator's kernels to compile before the first scan.
            coming[-1].result()
            for number in itertools.count(2):
                clip = coming.popleft().result()
                coming.append(
                    ahead.submit(self.generator.make, self.plan_stretch(number))
                )
                yield from self.build_scans(clip, stamp, touches)
                stamp += self.period * len(clip.counts)
                touches += len(clip.truths)

    def plan_stretch(self, number: int) -> ClipPlan:
        """Plan a stretch: no touch in the first, then all that people do."""
        person = Origin(
            f"{PLAYER_ROLE}-p{self.seed}",
            build_seed(f"person {PLAYER_ROLE}", 0, 0, self.seed),
        )
        session = Origin(
            f"{PLAYER_ROLE}-0000", build_seed(f"session {PLAYER_ROLE}", 0, 0, self.seed)
        )
        return ClipPlan(
            set_name=PLAYER_ROLE,
            seed=build_seed(f"clip {PLAYER_ROLE}", number, 0, self.seed),
            person=person,
            company=None,
            build=self.build,
            session=session,
            at=0.0,
            seconds=STRETCH_SECONDS if number else LEAD_SECONDS,
            gesture=None if number else "none",
            kind=None if number else "idle",
            groups=self.groups,
            pose=build_seed(f"pose {PLAYER_ROLE}", 0, 0, self.seed),
            moving=False,
            fold_share=0.0,
            concurrent=0.0,
            difficulty=self.difficulty,
            regime=None,
        )

    def build_scans(
        self, clip: SimulatedClip, start: int, first: int
    ) -> Iterator[SampledScan]:
        """Yield the scans of a clip, with its touches numbered from `first`."""
        for reading in range(len(clip.counts)):
            stamp = start + reading * self.period
            truths = tuple(
                truth.to_record(first + place, reading, stamp)
                for place, truth in enumerate(clip.truths)
                if truth.force[reading] > 0
            )
            scan = Scan(
                stamp, clip.counts[reading], clip.received[reading], clip.q[reading]
            )
            yield SampledScan(scan, truths)
