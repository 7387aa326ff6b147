"""Simulate clips of a named set in memory, and keep what the tables need."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int
from joblib import Parallel, delayed, parallel_config

from eskin.sim.constants import load_constants
from eskin.sim.dataset import ClipPlan, Simulator
from eskin.sim.dataset.clip import SimulatedClip
from eskin.sim.dataset.plan import SessionPlan, plan_clips, plan_sessions
from eskin.sim.dataset.session_file import compute_rest_counts
from eskin.sim.dataset.sets import CLASSES, load_set, resize_set
from eskin.touch import Calibration
from lab.simulation.features import clip_features
from lab.simulation.remains import (
    build_true_series,
    compute_histogram,
    compute_rest_statistics,
)

PROCESSES = 2
LEAST = 1.0
"""Pressure that a taxel must reach to be evaluated [kPa]."""
Factors = tuple[tuple[str, float], ...]
"""Names of constants, and the factor on each."""
TAP = "tap"
"""Name of the class of one pat."""


@dataclass(frozen=True, eq=False)
class ClipSummary:
    """A summary holds what the tables need of a clip."""

    plan: ClipPlan
    """Plan of the clip."""
    label: str
    """Class of the clip."""
    kind: str
    """Kind of the touch, such as `two_tips` or `bump`."""
    features: Float[np.ndarray, "feature"]
    """Features of `lab.simulation.features`."""
    truth: Float[np.ndarray, "reading 5"]
    """Force [N], area [cm2] and centroid [cm] of what was really done; the centroid in
    its link's frame, NaN without contact."""
    before: Float[np.ndarray, "quantity"]
    """Statistics of readings before any contact; NaN without such readings."""
    histogram: Float[np.ndarray, "bin"]
    """Histogram of the pressures of all taxels and readings."""
    pose_group: int
    """Group of the pose."""
    folded: bool
    """Whether patches of two links face each other."""
    q: Float[np.ndarray, "joint"]
    """Joint positions at the start [rad]."""
    link: str
    """Link that was touched; empty without a touch."""
    height: float
    """Height of the first contact above the robot's base [m]; NaN without contact."""
    peak: float
    """Largest pressure of a reading [kPa]."""
    seconds: float
    """True duration of the touch, also outside the clip [s]."""


def simulate(
    set_name: str,
    clips: int,
    difficulty: float,
    seed: int,
    classes: tuple[str, ...] = CLASSES,
    factors: Factors = (),
) -> list[ClipSummary]:
    """Simulate clips of a named set in two processes.

    Args:
        set_name: one of `eskin.sim.dataset.sets.SETS` without streams.
        clips: number of clips.
        difficulty: lambda.
        seed: seed of the set.
        classes: classes, equally often; `tap` is one pat.
        factors: factors on constants of the simulation, as in a sensitivity sweep.
    """
    constants = load_constants()
    chosen = resize_set(load_set(set_name, constants), clips, None, constants)
    chosen = replace(chosen, classes=classes)
    work = []
    for session in plan_sessions(chosen, seed, constants):
        plans = plan_clips(session, chosen, seed, difficulty, constants)
        work.append(delayed(simulate_session)(session, plans, TAP in classes, factors))
    with parallel_config(backend="loky", inner_max_num_threads=1):
        found: Sequence[list[ClipSummary]] = Parallel(PROCESSES)(work)  # pyright: ignore
    return [made for group in found for made in group]


@lru_cache(maxsize=2)
def get_simulator(factors: Factors = ()) -> Simulator:
    """Return the simulator of this process, with factors on its constants."""
    return Simulator(constants=load_constants().scaled(dict(factors)))


def simulate_session(
    session: SessionPlan, plans: Sequence[ClipPlan], taps: bool, factors: Factors = ()
) -> list[ClipSummary]:
    """Simulate the clips of a session; their rest level is that of its lead-in.

    Args:
        session: plan of the session.
        plans: plans of its lead-in and clips.
        taps: whether one pat is a class of its own.
        factors: factors on constants of the simulation.
    """
    simulator = get_simulator(factors)
    rest = compute_rest_counts(simulator.make(plans[0]))
    calibration = simulator.calibration(session.build)
    return [
        summarise_clip(simulator, as_tap(plan), rest, calibration, taps)
        for plan in plans[1:]
    ]


def as_tap(plan: ClipPlan) -> ClipPlan:
    """Return the plan of one pat for a `tap`; other plans stay unchanged."""
    if plan.gesture != TAP:
        return plan
    return replace(plan, gesture="none", kind="single_pat")


def summarise_clip(
    simulator: Simulator,
    plan: ClipPlan,
    rest: Float[np.ndarray, "taxel"],
    calibration: Calibration,
    taps: bool,
) -> ClipSummary:
    """Simulate one clip and keep what the tables need."""
    mounted, clip = simulator.mounted, simulator.make(plan)
    pressure = calibrate_counts(clip.counts, clip.received, rest, calibration)
    first = next((truth for truth in clip.truths if truth.number == 0), None)
    kind = first.kind if first else plan.kind or name_untouched_kind(clip)
    label = TAP if taps and kind == "single_pat" else plan.gesture or ""
    pressed = first is not None and first.force.any()
    start = int(np.flatnonzero(first.force)[0]) if first and pressed else 0
    return ClipSummary(
        plan=plan,
        label=label,
        kind=kind,
        features=clip_features(pressure, mounted.skin.positions, mounted.skin.areas),
        truth=build_true_series(clip, first, mounted),
        before=compute_rest_statistics(clip, rest, mounted.skin),
        histogram=compute_histogram(pressure),
        pose_group=clip.pose_group,
        folded=bool(clip.drawn["folded"]),
        q=clip.q[0],
        link=first.link if first else "",
        height=float(first.centroid[start, 2]) if first and pressed else np.nan,
        peak=float(pressure.max()),
        seconds=first.end - first.onset if first else 0.0,
    )


def name_untouched_kind(clip: SimulatedClip) -> str:
    """Return the kind of a clip without touch."""
    disturbed = any(name.startswith("electrical.") for name in clip.drawn)
    return "electrical" if disturbed else "idle"


def calibrate_counts(
    counts: Int[np.ndarray, "reading taxel"],
    received: Bool[np.ndarray, "reading taxel"],
    rest: Float[np.ndarray, "taxel"],
    calibration: Calibration,
) -> Float[np.ndarray, "reading taxel"]:
    """Return the pressure as a user of the build reads it [kPa].

    It is zero where nothing was received, and on taxels that never reach `LEAST`.
    """
    above = np.where(received, np.maximum(counts - rest, 0.0), 0.0)
    felt = np.flatnonzero((above > calibration.compute_counts(LEAST)).any(axis=0))
    pressure = np.zeros(counts.shape)
    those = replace(calibration, gain=calibration.gain[felt])
    pressure[:, felt] = those.compute_pressure(above[:, felt])
    return pressure
