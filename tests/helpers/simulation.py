"""These helpers make clips quickly: a stand-in for the simulator, and a small one.

Other processes find the generators by name.
"""

import os
import time
from functools import lru_cache

import numpy as np

from eskin.robot import load_robot
from eskin.sim import load_constants
from eskin.sim.contact.press import ContactSite
from eskin.sim.dataset import ClipGenerator, Simulator
from eskin.sim.dataset.clip import SimulatedClip
from eskin.sim.people.perform import perform
from eskin.sim.people.person import draw_person
from eskin.sim.scene.scene import TrueTouchSeries
from eskin.skin import MountedSkin, build_grid_skin
from eskin.touch import Calibration
from helpers.worlds import SMALL_POOL

RATE = 50
REST = 100
NOISE = 2
HIGH = 900
RAMP = np.array([0.25, 0.5, 0.25])
FULL_SCALE = 4095
PRESSURE = 100.0


@lru_cache
def build_small_simulator(skin):
    """Build the simulator of a preset skin with a small pool of poses, once."""
    return Simulator(skin, load_constants().scaled(SMALL_POOL))


def read_files(folder):
    """Return the bytes of every file by its path below the folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


CONSTANTS = load_constants()
SITE = ContactSite(0, (0.1, 0.15), 0.0375, (-0.12, 0.1), 0.4)
"""Site on a tube as thick as the forearm of the UR5."""


@lru_cache
def draw_people(count=2000):
    """Draw people, always the same ones."""
    rng = np.random.default_rng(5)
    return [draw_person(f"p{index}", CONSTANTS, rng) for index in range(count)]


@lru_cache
def perform_many(
    gesture, kind=None, difficulty=0.0, regime="paper", count=200, site=SITE
):
    """Draw one touch by each of some people."""
    rng = np.random.default_rng(11)
    return [
        perform(gesture, kind, person, site, CONSTANTS, rng, difficulty, regime)
        for person in draw_people()[:count]
    ]


class StandIn(ClipGenerator):
    """Presses one taxel in the middle of every clip that is not idle."""

    def __init__(self, skin):
        self.robot_name = "table"
        self.mounted = MountedSkin(
            build_grid_skin(3, 4, name=skin), load_robot("table")
        )

    def calibration(self, build):
        rng = build.rng()
        count = self.mounted.skin.count
        return Calibration.uniform(count, FULL_SCALE, PRESSURE + rng.integers(3))

    def make(self, plan):
        rng = plan.rng()
        times = np.arange(round(plan.seconds * RATE)) / RATE
        count = self.mounted.skin.count
        noise = rng.integers(-NOISE, NOISE + 1, (len(times), count))
        truths = () if plan.kind == "idle" else tuple(self.touches(plan, times, rng))
        counts = REST + noise
        for truth in truths:
            # No finger lands or lifts within one scan.
            press = np.convolve(truth.force > 0, RAMP, "same")
            counts[:, truth.number % count] += (HIGH * press).astype(int)
        received = rng.random(counts.shape) < 0.99
        counts[~received] = FULL_SCALE
        return SimulatedClip(
            counts=counts.astype(np.int32),
            received=received,
            q=np.zeros((len(times), 0)),
            truths=truths,
            pose_group=int(rng.choice(plan.groups)),
            drawn={"touch0.kind": "tip", "touch0.regime": "paper", "x": rng.random()},
        )

    def touches(self, plan, times, rng):
        onsets = [0.5] if plan.gesture else np.arange(2.0, plan.seconds - 2, 4.0)
        for number, onset in enumerate(onsets):
            end = onset + rng.uniform(0.3, 1.0)
            inside = (times >= onset) & (times < end)
            yield TrueTouchSeries(
                number=number,
                gesture=plan.gesture or "poke",
                kind="tip",
                subject=plan.person.name,
                link="table",
                force=5.0 * inside,
                area=1e-4 * inside,
                centroid=np.outer(times, [1.0, 2.0, 3.0]),
                onset=float(onset),
                end=float(end),
            )


class Failing(StandIn):
    """Fails at the clip that begins 12 s after its file, of the second person."""

    def make(self, plan):
        if plan.at == 12.0 and plan.person.name.endswith("p1"):
            self.fail()
        return super().make(plan)

    def fail(self):
        raise ZeroDivisionError("no force")


class Dying(Failing):
    """Ends its process at that clip."""

    def fail(self):
        os._exit(9)


class Slow(StandIn):
    """Sleeps before every clip."""

    def make(self, plan):
        time.sleep(0.1)
        return super().make(plan)
