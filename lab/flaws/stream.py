"""Run one build of a row: minutes without touch, then touches of a person.

A row says what is wrong with the sensor, build by build.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import lru_cache
from typing import get_args

import numpy as np

from eskin.live import Model, Recognizer, load_model
from eskin.recording import NONE, TruthRecord
from eskin.sim.constants import Constants
from eskin.sim.interactive import InteractiveSkin
from eskin.sim.scene.environment import load_environment
from eskin.sim.scene.poses import POSE_GROUPS, draw_pose
from eskin.sim.sensor import (
    FAMILIES,
    FLAWS,
    SensorBuild,
    draw_build,
    draw_flawed_build,
)
from eskin.sim.sensor.build import BuildKind
from eskin.sim.sensor.flaws import Family, FlawLevel
from eskin.skin import Skin
from eskin.units import NS_PER_S
from lab.flaws.scoring import RestCount, TouchScore, TrueContact, Watcher, score_touch

INTACT = "none"
ALL = "all typical"
LEVELS: tuple[FlawLevel, ...] = get_args(FlawLevel)
FLAWED: dict[str, Mapping[str, FlawLevel]] = {
    INTACT: {},
    ALL: dict.fromkeys(FLAWS, "typical"),
    **{f"{flaw} {level}": {flaw: level} for flaw in FLAWS for level in LEVELS},
}
"""Flaws of the builds of a row; their families take turns."""
KINDS: tuple[BuildKind, ...] = ("fresh", "shifted", *FAMILIES)
"""Rows whose builds have all flaws, drawn from the laws of a kind."""
ROWS = (*FLAWED, *KINDS)
"""Names of all rows."""
REFERENCES = {
    **dict.fromkeys(FLAWED, INTACT),
    **dict.fromkeys(KINDS, INTACT),
    "fresh": "fresh",
    "shifted": "fresh",
}
"""Row that each row is compared to."""


def find_family(number: int) -> Family:
    """Return the family of a build of a row whose families take turns."""
    return FAMILIES[number % len(FAMILIES)]


def draw_row_build(
    row: str, number: int, skin: Skin, constants: Constants, seed: int
) -> SensorBuild:
    """Draw a build of a row.

    Args:
        row: one of `ROWS`.
        number: number of the build, by which families take turns.
        skin: skin of the taxels.
        constants: constants of the simulation.
        seed: seed of the build.
    """
    rng = np.random.default_rng((seed, 25))
    name = f"flaws-b{number}"
    if row in FLAWED:
        family = find_family(number)
        return draw_flawed_build(name, family, FLAWED[row], skin, constants, rng)
    kind = KINDS[KINDS.index(row)]
    return draw_build(name, kind, skin, constants, rng)


SKIN = "ur5"
GESTURES = ("poke", "double_pat", "grab", "stroke")
SETTLING = 5.0
"""Time after the start that is not counted, in which rest is learned [s]."""
PAUSE = (1.5, 3.0)
"""Range of the time between two touches [s]."""
MOST_JITTER = 0.4
"""Largest error of a stamp, by the period of the scans."""
FIRST_SEED = 70_000
"""Seed of the first build; no other test draws from it."""


@dataclass(frozen=True)
class BuildPlan:
    """A plan holds the streams of one build of a row."""

    row: str
    """Name of the row, one of `ROWS`."""
    number: int
    """Number of the build; the same number has the same person, pose and touches."""
    minutes: float
    """Time without touch [min]."""
    touches: int
    """Number of touches."""
    model: str = "ur5"
    """Weights of the recogniser."""


@dataclass
class BuildResult:
    """Holds what one build gave."""

    row: str
    number: int
    rest: RestCount = field(default_factory=RestCount)
    """Counts of the time without touch."""
    touches: list[TouchScore] = field(default_factory=list)
    """Scores of the touches."""


@lru_cache(maxsize=2)
def get_model(name: str) -> Model:
    """Return weights, loaded once per process."""
    return load_model(name)


def build_live_skin(row: str, number: int, seed: int) -> InteractiveSkin:
    """Build the skin of a row."""
    env = load_environment(SKIN)
    build = draw_row_build(row, number, env.mounted.skin, env.constants, seed)
    return InteractiveSkin(SKIN, seed, build=build)


class BuildRun:
    """A run pushes the scans of one build to a recogniser that watches it."""

    def __init__(self, plan: BuildPlan) -> None:
        """Draw build, person and pose."""
        seed = FIRST_SEED + plan.number
        self.rng = np.random.default_rng(seed)
        self.live = build_live_skin(plan.row, plan.number, seed)
        flaws = self.live.build.flaws
        self.stamp_jitter = flaws.stamp_jitter if flaws else 0.0
        self.jitter_rng = np.random.default_rng((seed, 26))
        self.q = draw_pose(self.live.env, POSE_GROUPS, self.rng)
        model = get_model(plan.model)
        recognizer = Recognizer(model, self.live.mounted, self.live.calibration)
        self.watcher = Watcher(recognizer)
        self.scans = 0
        self.truths: list[TruthRecord] = []
        self.stamps: list[int] = []
        self.forces: list[float] = []

    def scan(self) -> None:
        """Simulate and recognise the next scan."""
        self.scans += 1
        most = MOST_JITTER * self.live.period
        late = self.stamp_jitter * self.jitter_rng.standard_normal()
        seconds = self.scans * self.live.period + float(np.clip(late, -most, most))
        stamp = round(seconds * NS_PER_S)
        scan = self.live.scan(stamp, self.q)
        self.stamps.append(stamp)
        self.forces.append(self.live.taxel_force)
        self.truths += self.live.hand.truths()
        self.watcher.push(scan)

    def wait(self, seconds: float) -> None:
        """Simulate a span of time [s]."""
        for _ in range(round(seconds / self.live.period)):
            self.scan()

    def rest(self, seconds: float) -> RestCount:
        """Simulate a span of time and return the counts of it."""
        self.watcher.rest = count = RestCount()
        self.wait(seconds)
        self.watcher.rest = RestCount()
        return count

    def touch(self, gesture: str) -> TouchScore | None:
        """Perform a touch and a pause; return its score, or None without force."""
        self.truths = []
        self.stamps = []
        self.forces = []
        self.watcher.follow()
        self.live.hand.perform(gesture)
        while self.live.hand.touching:
            self.scan()
        self.wait(self.rng.uniform(*PAUSE))
        truth = build_truth(self.truths, self.stamps, self.forces)
        if not truth.pressed.any():
            return None
        trails = self.watcher.trails
        assert trails is not None
        return score_touch(truth, trails)


def build_truth(
    truths: list[TruthRecord], stamps: list[int], forces: list[float]
) -> TrueContact:
    """Build the true contact of the only touch among records.

    Args:
        truths: records of the touch.
        stamps: stamps of all scans [ns].
        forces: true force on all taxels at each scan [N].
    """
    centre = np.full((len(stamps), 3), np.nan)
    places = {stamp: place for place, stamp in enumerate(stamps)}
    for truth in truths:
        centre[places[truth.stamp]] = truth.p_world
    gesture = truths[0].gesture if truths else NONE
    return TrueContact(gesture, np.array(stamps), np.array(forces), centre)


def run_build(plan: BuildPlan) -> BuildResult:
    """Run the quiet minutes and the touches of one build."""
    run = BuildRun(plan)
    result = BuildResult(plan.row, plan.number)
    run.wait(SETTLING)
    result.rest = run.rest(60.0 * plan.minutes)
    wanted = [GESTURES[i % len(GESTURES)] for i in range(plan.touches)]
    for gesture in run.rng.permutation(wanted):
        score = run.touch(str(gesture))
        result.touches += [score] if score else []
    return result
