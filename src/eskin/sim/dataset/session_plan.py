"""Session plans split a set into files, and plan the clips of each file."""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import cast

import numpy as np

from eskin.sim.constants import Constants
from eskin.sim.dataset.plan import (
    NONE_KINDS,
    PAIR_SIDES,
    SIDE_SKINS,
    BuildOrigin,
    ClipPlan,
    Origin,
    PairKind,
    PairPlace,
    Seed,
    Side,
    find_pair_kind,
)
from eskin.sim.dataset.sets import ClipSet
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class SessionPlan:
    """One file of a set: the skin is attached once, one person touches."""

    file: str
    """Path of the recording below the folder of the set."""
    number: int
    """Counts the files of the set."""
    first: int
    """Number of its first clip among those of its part."""
    clips: int
    """How many clips it has."""
    person: Origin
    """Who touches."""
    others: tuple[Origin, ...]
    """Who else may touch at the same time."""
    build: BuildOrigin
    """The sensor."""
    session: Origin
    """What stays the same during the sitting."""
    start: int
    """Its first stamp [ns since the epoch]."""


def build_seed(role: str, first: int, second: int, seed: int) -> Seed:
    """The seed of something in a role; no two things share one.

    The seed of the set comes last since it may take any number of words.
    """
    return (zlib.crc32(role.encode()), first, second, seed)


def plan_sessions(
    chosen: ClipSet, seed: int, constants: Constants
) -> tuple[SessionPlan, ...]:
    """The files of a set, in order."""
    people = [
        Origin(
            f"{chosen.people}-p{i}", build_seed(f"person {chosen.people}", i, 0, seed)
        )
        for i in range(chosen.subjects)
    ]
    found: list[SessionPlan] = []
    for part in chosen.parts:
        first = 0
        for subject, clips in split_clips(chosen, part.clips, constants):
            number = len(found)
            name = f"{chosen.name}-{number:04d}"
            others = people[:subject] + people[subject + 1 :]
            found.append(
                SessionPlan(
                    file=f"{part.folder}/{name}.mcap".lstrip("/"),
                    number=number,
                    first=first,
                    clips=clips,
                    person=people[subject],
                    others=tuple(others),
                    build=plan_build(chosen, subject, seed),
                    session=Origin(
                        name, build_seed(f"session {chosen.name}", number, 0, seed)
                    ),
                    start=compute_start(number, constants),
                )
            )
            first += clips
    return tuple(found)


def plan_build(chosen: ClipSet, subject: int, seed: int) -> BuildOrigin:
    """The sensor that a person meets."""
    number = subject % chosen.build_count
    role = f"build {chosen.builds}"
    return BuildOrigin(
        f"{chosen.builds}-b{number}",
        build_seed(role, number, 0, seed),
        chosen.build_kind,
    )


def compute_start(number: int, constants: Constants) -> int:
    """The first stamp of a file [ns since the epoch]."""
    epoch, apart = constants.value("sets.epoch"), constants.value("sets.apart")
    return (int(epoch) + number * int(apart)) * NS_PER_S


def split_clips(
    chosen: ClipSet, clips: int, constants: Constants
) -> Iterator[tuple[int, int]]:
    """Person and number of clips of each sitting of a part."""
    most = int(constants.value("clip.most")) if chosen.classes else 1
    for subject, share in enumerate(split_evenly(clips, chosen.subjects)):
        for count in split_evenly(share, -(-share // most)):
            yield subject, count


def split_evenly(total: int, shares: int) -> list[int]:
    """A number in so many shares that differ by one at most; none is empty."""
    parts = [total * (i + 1) // shares - total * i // shares for i in range(shares)]
    return [part for part in parts if part]


IDLE = "idle"
"""Kind of `none` in which nothing touches."""


def plan_clips(
    sitting: SessionPlan,
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
    rng = build_rng(build_seed(f"order {chosen.name}", sitting.number, 0, seed))
    lead = plan_lead_in(sitting, chosen, seed, difficulty, constants)
    gestures = draw_gestures(sitting, chosen, rng)
    seconds = draw_seconds(sitting, chosen, seed, constants)
    every = constants.value("clip.every")
    chance = difficulty * constants.value("clip.concurrent")
    plans = [lead]
    for number, gesture in enumerate(gestures):
        plans.append(
            replace(
                lead,
                seed=build_seed(f"clip {chosen.name}", sitting.number, number, seed),
                company=draw_companion(sitting, rng),
                at=every * (number + 1),
                seconds=seconds,
                gesture=gesture,
                kind=chosen.stream,
                pose=draw_pose_seed(chosen, seed, rng),
                moving=bool(rng.random() >= chosen.still),
                fold_share=constants.value("clip.fold"),
                concurrent=min(chance, constants.value("difficulty.most")),
            )
        )
    return tuple(plans)


def build_rng(seed: Seed) -> np.random.Generator:
    """A fresh generator."""
    return np.random.default_rng(np.random.SeedSequence(seed))


def plan_lead_in(
    sitting: SessionPlan,
    chosen: ClipSet,
    seed: int,
    difficulty: float,
    constants: Constants,
) -> ClipPlan:
    """What calibration begins with."""
    return ClipPlan(
        set_name=chosen.name,
        seed=build_seed(f"lead {chosen.name}", sitting.number, 0, seed),
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


def draw_gestures(
    sitting: SessionPlan, chosen: ClipSet, rng: np.random.Generator
) -> list[str | None]:
    """What each clip shows: equally often in a part of a set, in any order."""
    if not chosen.classes:
        return [None] * sitting.clips
    count = len(chosen.classes)
    order = rng.permutation(sitting.first + np.arange(sitting.clips))
    return [chosen.classes[int(number) % count] for number in order]


def draw_seconds(
    sitting: SessionPlan, chosen: ClipSet, seed: int, constants: Constants
) -> float:
    """Length of the clips of a sitting [s]; streams share a range evenly."""
    if chosen.classes:
        return constants.value("clip.seconds")
    rng = build_rng(build_seed(f"lengths {chosen.name}", 0, 0, seed))
    place = int(rng.permutation(chosen.clips)[sitting.number])
    low, high = constants.array(f"sets.{chosen.stream or 'stream'}_seconds")
    period = constants.value("sensor.period")
    seconds = low + (high - low) * (place + 0.5) / chosen.clips
    return round(seconds / period) * period


def draw_companion(sitting: SessionPlan, rng: np.random.Generator) -> Origin | None:
    """Somebody else of the set, where there is anybody."""
    if not sitting.others:
        return None
    return sitting.others[int(rng.integers(len(sitting.others)))]


def draw_pose_seed(chosen: ClipSet, seed: int, rng: np.random.Generator) -> Seed | None:
    """One of the poses of the set, where it has only some."""
    if chosen.poses is None:
        return None
    number = int(rng.integers(chosen.poses))
    return build_seed(f"pose {chosen.people}", number, 0, seed)


def plan_pair_sessions(
    sittings: Sequence[SessionPlan], seed: int
) -> tuple[SessionPlan, ...]:
    """Sittings of a set of pairs, those of either side of a kind in one session."""
    found = []
    for sitting in sittings:
        kind = find_pair_kind(find_side(sitting))
        name = f"pairs-{kind}-{sitting.first:04d}"
        origin = Origin(
            name, build_seed(f"session pairs {kind}", sitting.first, 0, seed)
        )
        found.append(replace(sitting, session=origin))
    return tuple(found)


def find_side(sitting: SessionPlan) -> Side:
    """The side that a sitting is of, which its folder is called by."""
    return cast(Side, PurePosixPath(sitting.file).parent.name)


def find_skin(sitting: SessionPlan, skin: str) -> str:
    """The preset that a sitting of a set of pairs is made with."""
    return SIDE_SKINS.get(find_side(sitting), skin)


def plan_pair_clips(
    sitting: SessionPlan,
    chosen: ClipSet,
    seed: int,
    difficulty: float,
    constants: Constants,
) -> tuple[ClipPlan, ...]:
    """The lead-in of a sitting, without touch, then its side of each pair."""
    side = find_side(sitting)
    kind = find_pair_kind(side)
    usual = plan_lead_in(sitting, chosen, seed, difficulty, constants)
    lead = replace(
        usual,
        seed=build_seed(f"lead pairs {kind}", sitting.first, 0, seed),
        pair=PairPlace(-1, side, "none"),
    )
    every = constants.value("clip.every")
    plans = [lead]
    for place in range(sitting.clips):
        number = sitting.first + place
        at = every * (place + 1)
        plans.append(plan_pair_clip(lead, side, number, at, seed, constants))
    return tuple(plans)


def plan_pair_clip(
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
    kind = find_pair_kind(side)
    rng = np.random.default_rng(
        np.random.SeedSequence(build_seed(f"gesture pairs {kind}", number, 0, seed))
    )
    gesture = constants.choose(f"pairs.{kind}", rng)
    place = PairPlace(number, side, gesture)
    return replace(
        lead,
        seed=build_seed(f"clip pairs {kind}", number, 0, seed),
        at=at,
        seconds=constants.value("clip.seconds"),
        gesture="none" if place.is_second else gesture,
        kind=NONE_KINDS[gesture] if place.is_second else None,
        pair=place,
    )


def plan_single_pair(
    kind: PairKind, seed: int, difficulty: float, constants: Constants
) -> ClipPlan:
    """The plan of the first clip of a pair whose person and sensor are its own."""

    def origin(role: str) -> Origin:
        return Origin(f"pair-{role}", build_seed(f"pair {role}", 0, 0, seed))

    build = origin("build")
    groups = (
        *constants.array("sets.groups.known"),
        *constants.array("sets.groups.new"),
    )
    lead = ClipPlan(
        set_name="pairs",
        seed=build_seed("lead pair", 0, 0, seed),
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
    return plan_pair_clip(lead, PAIR_SIDES[kind][0], 0, 0.0, seed, constants)
