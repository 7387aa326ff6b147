"""Which pairs a set has: the same people, sensors and seeds on both sides."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import PurePosixPath
from typing import cast

import numpy as np

from eskin.sim.clip.plan import BuildOrigin, ClipPlan, Origin
from eskin.sim.constants import Constants
from eskin.sim.files.schedule import lead_in
from eskin.sim.files.sets import ClipSet
from eskin.sim.files.sitting import Sitting, seed_of
from eskin.sim.pairs.sides import (
    INSTEAD,
    KINDS,
    SKINS,
    PairKind,
    PairPlace,
    Side,
    kind_of_side,
)


def pair_sittings(sittings: Sequence[Sitting], seed: int) -> tuple[Sitting, ...]:
    """Sittings of a set of pairs, those of either side of a kind in one session."""
    found = []
    for sitting in sittings:
        kind = kind_of_side(side_of(sitting))
        name = f"pairs-{kind}-{sitting.first:04d}"
        origin = Origin(name, seed_of(f"session pairs {kind}", sitting.first, 0, seed))
        found.append(replace(sitting, session=origin))
    return tuple(found)


def side_of(sitting: Sitting) -> Side:
    """The side that a sitting is of, which its folder is called by."""
    return cast(Side, PurePosixPath(sitting.file).parent.name)


def skin_of(sitting: Sitting, skin: str) -> str:
    """The preset that a sitting of a set of pairs is made with."""
    return SKINS.get(side_of(sitting), skin)


def pair_plans(
    sitting: Sitting,
    chosen: ClipSet,
    seed: int,
    difficulty: float,
    constants: Constants,
) -> tuple[ClipPlan, ...]:
    """The lead-in of a sitting, without touch, then its side of each pair."""
    side = side_of(sitting)
    kind = kind_of_side(side)
    usual = lead_in(sitting, chosen, seed, difficulty, constants)
    lead = replace(
        usual,
        seed=seed_of(f"lead pairs {kind}", sitting.first, 0, seed),
        pair=PairPlace(-1, side, "none"),
    )
    every = constants.value("clip.every")
    plans = [lead]
    for place in range(sitting.clips):
        number = sitting.first + place
        at = every * (place + 1)
        plans.append(pair_plan(lead, side, number, at, seed, constants))
    return tuple(plans)


def pair_plan(
    lead: ClipPlan, side: Side, number: int, at: float, seed: int, constants: Constants
) -> ClipPlan:
    """One side of a pair; the other has the same seed.

    Args:
        lead: the lead-in of its sitting.
        side: which.
        number: of the pair among those of its kind.
        at: start of the clip since that of the sitting [s].
        seed: of the set.
        constants: numbers of the world.
    """
    kind = kind_of_side(side)
    rng = np.random.default_rng(
        np.random.SeedSequence(seed_of(f"gesture pairs {kind}", number, 0, seed))
    )
    gesture = constants.choose(f"pairs.{kind}", rng)
    place = PairPlace(number, side, gesture)
    return replace(
        lead,
        seed=seed_of(f"clip pairs {kind}", number, 0, seed),
        at=at,
        seconds=constants.value("clip.seconds"),
        gesture="none" if place.is_second else gesture,
        kind=INSTEAD[gesture] if place.is_second else None,
        pair=place,
    )


def plan_alone(
    kind: PairKind, seed: int, difficulty: float, constants: Constants
) -> ClipPlan:
    """The plan of the first clip of a pair whose person and sensor are its own."""

    def origin(role: str) -> Origin:
        return Origin(f"pair-{role}", seed_of(f"pair {role}", 0, 0, seed))

    build = origin("build")
    groups = (
        *constants.array("sets.groups.known"),
        *constants.array("sets.groups.new"),
    )
    lead = ClipPlan(
        set_name="pairs",
        seed=seed_of("lead pair", 0, 0, seed),
        person=origin("person"),
        company=None,
        build=BuildOrigin(build.name, build.seed, "fresh"),
        session=origin("session"),
        at=0.0,
        seconds=constants.value("sets.lead"),
        gesture="none",
        kind="idle",
        groups=tuple(int(group) for group in groups),
        pose=None,
        moving=False,
        fold_share=0.0,
        concurrent=0.0,
        difficulty=difficulty,
        regime=None,
    )
    return pair_plan(lead, KINDS[kind][0], 0, 0.0, seed, constants)
