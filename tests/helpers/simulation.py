"""A stand-in for the simulator: quick, and found by name in other processes."""

import os
import time

import numpy as np

from eskin.robot import load_robot
from eskin.sim.dataset import ClipGenerator
from eskin.sim.dataset.clip import SimulatedClip
from eskin.sim.scene.scene import TrueTouchSeries
from eskin.skin import MountedSkin, build_grid_skin
from eskin.touch import Calibration

RATE = 50
REST, NOISE, HIGH = 100, 2, 900
FULL_SCALE, PRESSURE = 4095, 100.0


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
            counts[:, truth.number % count] += (HIGH * (truth.force > 0)).astype(int)
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
    """Cannot make the clip that begins 12 s after its file, of the second person."""

    def make(self, plan):
        if plan.at == 12.0 and plan.person.name.endswith("p1"):
            raise ZeroDivisionError("no force")
        return super().make(plan)


class Slow(StandIn):
    """Takes its time."""

    def make(self, plan):
        time.sleep(0.02)
        return super().make(plan)


class Dying(StandIn):
    """Ends its process at the same clip."""

    def make(self, plan):
        if plan.at == 12.0 and plan.person.name.endswith("p1"):
            os._exit(9)
        return super().make(plan)
