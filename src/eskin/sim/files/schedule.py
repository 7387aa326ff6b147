"""What is done in a sitting, clip by clip."""

from dataclasses import replace

import numpy as np

from eskin.sim.clip.plan import ClipPlan, Origin, Seed
from eskin.sim.constants import Constants
from eskin.sim.files.sets import ClipSet
from eskin.sim.files.sitting import Sitting, seed_of

IDLE = "idle"
"""Kind of `none` in which nothing touches."""


def plans_of(
    sitting: Sitting,
    chosen: ClipSet,
    seed: int,
    difficulty: float,
    constants: Constants,
) -> tuple[ClipPlan, ...]:
    """The lead-in of a sitting, without touch, then its clips.

    Args:
        sitting: one of the set's.
        chosen: the set.
        seed: of the whole set.
        difficulty: of all clips.
        constants: numbers of the world.
    """
    rng = generator(seed_of(f"order {chosen.name}", sitting.number, 0, seed))
    lead = lead_in(sitting, chosen, seed, difficulty, constants)
    gestures = gestures_of(sitting, chosen, rng)
    seconds = seconds_of(sitting, chosen, seed, constants)
    every = constants.value("clip.every")
    chance = difficulty * constants.value("clip.concurrent")
    plans = [lead]
    for number, gesture in enumerate(gestures):
        plans.append(
            replace(
                lead,
                seed=seed_of(f"clip {chosen.name}", sitting.number, number, seed),
                company=company_of(sitting, rng),
                at=every * (number + 1),
                seconds=seconds,
                gesture=gesture,
                kind=chosen.stream,
                pose=pose_of(chosen, seed, rng),
                moving=bool(rng.random() >= chosen.still),
                fold_share=constants.value("clip.fold"),
                concurrent=min(chance, constants.value("difficulty.most")),
            )
        )
    return tuple(plans)


def generator(seed: Seed) -> np.random.Generator:
    """A fresh generator."""
    return np.random.default_rng(np.random.SeedSequence(seed))


def lead_in(
    sitting: Sitting,
    chosen: ClipSet,
    seed: int,
    difficulty: float,
    constants: Constants,
) -> ClipPlan:
    """What calibration begins with."""
    return ClipPlan(
        set_name=chosen.name,
        seed=seed_of(f"lead {chosen.name}", sitting.number, 0, seed),
        person=sitting.person,
        company=None,
        build=sitting.build,
        session=sitting.session,
        at=0.0,
        seconds=constants.value("sets.lead"),
        gesture="none",
        kind=IDLE,
        groups=chosen.groups,
        pose=None,
        moving=False,
        fold_share=0.0,
        concurrent=0.0,
        difficulty=difficulty,
        regime=None,
    )


def gestures_of(
    sitting: Sitting, chosen: ClipSet, rng: np.random.Generator
) -> list[str | None]:
    """What each clip shows: equally often in a part of a set, in any order."""
    if not chosen.classes:
        return [None] * sitting.clips
    count = len(chosen.classes)
    order = rng.permutation(sitting.first + np.arange(sitting.clips))
    return [chosen.classes[int(number) % count] for number in order]


def seconds_of(
    sitting: Sitting, chosen: ClipSet, seed: int, constants: Constants
) -> float:
    """Length of the clips of a sitting [s]; streams share a range evenly."""
    if chosen.classes:
        return constants.value("clip.seconds")
    rng = generator(seed_of(f"lengths {chosen.name}", 0, 0, seed))
    place = int(rng.permutation(chosen.clips)[sitting.number])
    low, high = constants.array(f"sets.{chosen.stream or 'stream'}_seconds")
    period = constants.value("sensor.period")
    seconds = low + (high - low) * (place + 0.5) / chosen.clips
    return round(seconds / period) * period


def company_of(sitting: Sitting, rng: np.random.Generator) -> Origin | None:
    """Somebody else of the set, where there is anybody."""
    if not sitting.others:
        return None
    return sitting.others[int(rng.integers(len(sitting.others)))]


def pose_of(chosen: ClipSet, seed: int, rng: np.random.Generator) -> Seed | None:
    """One of the poses of the set, where it has only some."""
    if chosen.poses is None:
        return None
    number = int(rng.integers(chosen.poses))
    return seed_of(f"pose {chosen.people}", number, 0, seed)
