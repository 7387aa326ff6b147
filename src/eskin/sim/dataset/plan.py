"""Plans define the files of a set, and all about a clip before it is simulated."""

import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath
from typing import Literal, cast

import numpy as np

from eskin.recording import NONE
from eskin.recording.mcap_file import MCAP_SUFFIX
from eskin.sim.constants import Constants
from eskin.sim.dataset.sets import (
    NONE_KINDS,
    PAIR_SIDES,
    ClipSet,
    PairKind,
    Side,
    find_pair_kind,
    get_pose_groups,
)
from eskin.sim.sensor.build import BuildKind
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class PairMember:
    """A pair member says which clip of which pair of its set a clip is."""

    number: int
    """Number of the pair among the pairs of its kind; -1 for the lead-in."""
    side: Side
    """Side of the pair."""
    gesture: str
    """Gesture of the pair's first clip."""

    @property
    def kind(self) -> PairKind:
        """Return the kind of pair."""
        return find_pair_kind(self.side)

    @property
    def is_second(self) -> bool:
        """Tell whether the clip is the one labelled `none`."""
        return self.side == PAIR_SIDES[self.kind][1]


Seed = tuple[int, ...]
"""Entropy of `np.random.SeedSequence`; unique within a set."""


def build_rng(seed: Seed) -> np.random.Generator:
    """Build a random generator in its initial state."""
    return np.random.default_rng(np.random.SeedSequence(seed))


@dataclass(frozen=True)
class Origin:
    """An origin is the name of something random and the seed that it is drawn from."""

    name: str
    """Name in recordings."""
    seed: Seed
    """Seed that it is drawn from."""

    def rng(self) -> np.random.Generator:
        """Return a random generator in its initial state."""
        return build_rng(self.seed)


@dataclass(frozen=True)
class BuildOrigin(Origin):
    """A build origin is the name, seed and kind of a sensor build."""

    kind: BuildKind
    """Laws that it is drawn from."""


@dataclass(frozen=True, kw_only=True)
class ClipPlan:
    """A clip plan holds everything needed to simulate one clip or stream alone."""

    set_name: str
    """Name of the set."""
    seed: Seed
    """Seed of everything that is drawn for this clip alone."""
    person: Origin
    """Person who touches."""
    company: Origin | None = None
    """Another person who may touch at the same time, if any."""
    build: BuildOrigin
    """Build of the sensor."""
    session: Origin
    """Origin of the constants of a session, such as the drift of the gains."""
    at: float = 0.0
    """Start of the clip since the start of the session [s]."""
    seconds: float
    """Length of the clip [s]."""
    gesture: str | None
    """Gesture, `none` or an unknown gesture; None is a stream of touches."""
    kind: str | None
    """Variant; None draws it. For streams `ACCIDENTS`, `QUIET`, or None for one with
    gestures."""
    groups: tuple[int, ...]
    """Pose groups that the pose is drawn from."""
    pose: Seed | None = None
    """Seed of a pose that several clips share; None draws one for this clip alone."""
    places: tuple[Seed, ...] = ()
    """Seeds of the places of the skin that the gesture is made at, in the order in
    which the person tries them; empty draws one for this clip alone."""
    moving: bool = False
    """Whether the robot moves."""
    fold_share: float = 0.0
    """Probability of a pose in which patches of two links face each other closely."""
    concurrent: float = 0.0
    """Probability of a second touch at the same time."""
    difficulty: float
    """Factor by which spreads widen and rare variants gain weight; 0 is the easiest."""
    regime: Literal["paper", "cost"] | None = None
    """Distribution of durations; None draws it."""
    pair: PairMember | None = None
    """Pair with the same counts that the clip belongs to, if any."""

    def rng(self) -> np.random.Generator:
        """Return the random generator of this clip alone, in its initial state."""
        return build_rng(self.seed)


@dataclass(frozen=True)
class SessionPlan:
    """A session plan describes one file of a set: one person on one sensor."""

    file: str
    """Path of the recording below the folder of the set."""
    number: int
    """Number of the file in the set."""
    first: int
    """Number of its first clip within its part of the set."""
    clips: int
    """Number of clips."""
    person: Origin
    """Person who touches."""
    others: tuple[Origin, ...]
    """People who may touch at the same time."""
    build: BuildOrigin
    """Build of the sensor."""
    session: Origin
    """Origin of the constants of the session."""
    start: int
    """Stamp of its first reading [ns since the epoch]."""


def build_seed(role: str, first: int, second: int, seed: int) -> Seed:
    """Build the seed of something in a role, unique by role and both numbers.

    The seed of the set is last, since its number of words varies.
    """
    return (zlib.crc32(role.encode()), first, second, seed)


def plan_sessions(
    clip_set: ClipSet, seed: int, constants: Constants
) -> tuple[SessionPlan, ...]:
    """Plan the files of a set, in order."""
    people = [
        Origin(
            clip_set.names[i] if clip_set.names else f"{clip_set.people}-p{i}",
            build_seed(f"person {clip_set.people}", i, 0, seed),
        )
        for i in range(clip_set.subjects)
    ]
    epoch, apart = (int(constants.value(f"sets.{name}")) for name in ("epoch", "apart"))
    found: list[SessionPlan] = []
    for part in clip_set.parts:
        first = 0
        for subject, clips in split_clips(clip_set, part.clips, constants):
            number = len(found)
            name = f"{clip_set.name}-{number:04d}"
            others = people[:subject] + people[subject + 1 :]
            found.append(
                SessionPlan(
                    file=f"{part.folder}/{name}{MCAP_SUFFIX}".lstrip("/"),
                    number=number,
                    first=first,
                    clips=clips,
                    person=people[subject],
                    others=tuple(others),
                    build=plan_build(clip_set, subject, number, seed),
                    session=Origin(
                        name, build_seed(f"session {clip_set.name}", number, 0, seed)
                    ),
                    start=(epoch + number * apart) * NS_PER_S,
                )
            )
            first += clips
    return tuple(found)


def plan_build(clip_set: ClipSet, subject: int, session: int, seed: int) -> BuildOrigin:
    """Return the sensor build that a person touches in a session."""
    if clip_set.families:
        family = clip_set.families[session % len(clip_set.families)]
        return BuildOrigin(
            f"{clip_set.builds}-{family}-b{session}",
            build_seed(f"build {clip_set.builds} {family}", session, 0, seed),
            family,
        )
    number = subject % clip_set.build_count
    role = f"build {clip_set.builds}"
    return BuildOrigin(
        f"{clip_set.builds}-b{number}",
        build_seed(role, number, 0, seed),
        clip_set.build_kind,
    )


def split_clips(
    clip_set: ClipSet, clips: int, constants: Constants
) -> Iterator[tuple[int, int]]:
    """Split the clips of a part into sessions; yield person and number of clips."""
    name = "sets.family_session" if clip_set.families else "clip.most"
    max_clips = int(constants.value(name)) if clip_set.classes else 1
    for subject, share in enumerate(split_evenly(clips, clip_set.subjects)):
        for count in split_evenly(share, -(-share // max_clips)):
            yield subject, count


def split_evenly(total: int, shares: int) -> list[int]:
    """Split a number into non-zero shares that differ by at most one."""
    parts = [total * (i + 1) // shares - total * i // shares for i in range(shares)]
    return [part for part in parts if part]


IDLE = "idle"
"""Kind of `none` in which nothing touches."""


def plan_clips(
    session_plan: SessionPlan,
    clip_set: ClipSet,
    seed: int,
    difficulty: float,
    constants: Constants,
) -> tuple[ClipPlan, ...]:
    """Plan the lead-in of a session, without touch, then its clips."""
    rng = build_rng(build_seed(f"order {clip_set.name}", session_plan.number, 0, seed))
    lead = plan_lead_in(session_plan, clip_set, seed, difficulty, constants)
    gestures = draw_gestures(session_plan, clip_set, rng)
    seconds = draw_seconds(session_plan, clip_set, seed, constants)
    every = constants.value("clip.every")
    concurrent = difficulty * constants.value("clip.concurrent")
    fold_share = clip_set.folded
    if fold_share is None:
        fold_share = constants.value("clip.fold")
    others = session_plan.others
    plans = [lead]
    for number, gesture in enumerate(gestures):
        company = others[int(rng.integers(len(others)))] if others else None
        pose = None
        if clip_set.poses is not None:
            which = int(rng.integers(clip_set.poses))
            pose = build_seed(f"pose {clip_set.people}", which, 0, seed)
        places: tuple[Seed, ...] = ()
        if clip_set.places is not None:
            role = f"place {clip_set.people} {gesture}"
            order = rng.permutation(clip_set.places)
            places = tuple(build_seed(role, int(n), 0, seed) for n in order)
        kind = clip_set.stream
        if gesture == NONE and clip_set.kinds is not None:
            kind = constants.choose(clip_set.kinds, rng)
        plan = replace(
            lead,
            seed=build_seed(f"clip {clip_set.name}", session_plan.number, number, seed),
            company=company,
            at=every * (number + 1),
            seconds=seconds,
            gesture=gesture,
            kind=kind,
            pose=pose,
            places=places,
            moving=bool(rng.random() >= clip_set.stopped),
            fold_share=fold_share,
            concurrent=min(concurrent, constants.value("difficulty.most")),
        )
        plans.append(plan)
    return tuple(plans)


def plan_lead_in(
    session_plan: SessionPlan,
    clip_set: ClipSet,
    seed: int,
    difficulty: float,
    constants: Constants,
) -> ClipPlan:
    """Plan the clip without touch at the start of a session."""
    return ClipPlan(
        set_name=clip_set.name,
        seed=build_seed(f"lead {clip_set.name}", session_plan.number, 0, seed),
        person=session_plan.person,
        build=session_plan.build,
        session=session_plan.session,
        seconds=constants.value("sets.lead"),
        gesture="none",
        kind=IDLE,
        groups=clip_set.groups,
        difficulty=difficulty,
    )


def draw_gestures(
    session_plan: SessionPlan, clip_set: ClipSet, rng: np.random.Generator
) -> list[str | None]:
    """Draw the gestures of clips in random order, balanced over a part of a set."""
    if not clip_set.classes:
        return [None] * session_plan.clips
    order = rng.permutation(session_plan.first + np.arange(session_plan.clips))
    return [clip_set.classes[int(n) % len(clip_set.classes)] for n in order]


def draw_seconds(
    session_plan: SessionPlan, clip_set: ClipSet, seed: int, constants: Constants
) -> float:
    """Draw the length of the clips of a session [s], stratified over streams."""
    if clip_set.classes:
        return constants.value("clip.seconds")
    rng = build_rng(build_seed(f"lengths {clip_set.name}", 0, 0, seed))
    stratum = int(rng.permutation(clip_set.clips)[session_plan.number])
    low, high = constants.array(f"sets.{clip_set.stream or 'stream'}_seconds")
    period = constants.value("sensor.period")
    seconds = low + (high - low) * (stratum + 0.5) / clip_set.clips
    return round(seconds / period) * period


def plan_pair_sessions(
    sessions: Sequence[SessionPlan], seed: int
) -> tuple[SessionPlan, ...]:
    """Return sessions in which both sides of each kind of pair have the same origin."""
    found = []
    for plan in sessions:
        kind = find_pair_kind(find_side(plan))
        own = build_seed(f"session pairs {kind}", plan.first, 0, seed)
        origin = Origin(f"pairs-{kind}-{plan.first:04d}", own)
        found.append(replace(plan, session=origin))
    return tuple(found)


def find_side(session_plan: SessionPlan) -> Side:
    """Return the side of a session of pairs, which is the name of its folder."""
    return cast(Side, PurePosixPath(session_plan.file).parent.name)


def plan_pair_clips(
    session_plan: SessionPlan,
    clip_set: ClipSet,
    seed: int,
    difficulty: float,
    constants: Constants,
) -> tuple[ClipPlan, ...]:
    """Plan the lead-in of a session, without touch, then its side of each pair."""
    side = find_side(session_plan)
    kind = find_pair_kind(side)
    lead = replace(
        plan_lead_in(session_plan, clip_set, seed, difficulty, constants),
        seed=build_seed(f"lead pairs {kind}", session_plan.first, 0, seed),
        pair=PairMember(-1, side, "none"),
    )
    every = constants.value("clip.every")
    pairs = (
        plan_pair_clip(
            lead, side, session_plan.first + i, every * (i + 1), seed, constants
        )
        for i in range(session_plan.clips)
    )
    return (lead, *pairs)


def plan_pair_clip(
    lead: ClipPlan, side: Side, number: int, at: float, seed: int, constants: Constants
) -> ClipPlan:
    """Plan one clip of a pair; both clips have the same seed.

    `number` counts the pairs of its kind; `at` is the start of the clip since the start
    of the session [s].
    """
    kind = find_pair_kind(side)
    rng = build_rng(build_seed(f"gesture pairs {kind}", number, 0, seed))
    gesture = constants.choose(f"pairs.{kind}", rng)
    member = PairMember(number, side, gesture)
    return replace(
        lead,
        seed=build_seed(f"clip pairs {kind}", number, 0, seed),
        at=at,
        seconds=constants.value("clip.seconds"),
        gesture="none" if member.is_second else gesture,
        kind=NONE_KINDS[gesture] if member.is_second else None,
        pair=member,
    )


def plan_single_pair(
    kind: PairKind, seed: int, difficulty: float, constants: Constants
) -> ClipPlan:
    """Plan the first clip of a pair outside any set, with its own person and sensor."""

    def origin(role: str) -> Origin:
        return Origin(f"pair-{role}", build_seed(f"pair {role}", 0, 0, seed))

    build = origin("build")
    lead = ClipPlan(
        set_name="pairs",
        seed=build_seed("lead pair", 0, 0, seed),
        person=origin("person"),
        build=BuildOrigin(build.name, build.seed, "fresh"),
        session=origin("session"),
        seconds=constants.value("sets.lead"),
        gesture="none",
        kind=IDLE,
        groups=get_pose_groups(constants, "known", "new"),
        difficulty=difficulty,
    )
    return plan_pair_clip(lead, PAIR_SIDES[kind][0], 0, 0.0, seed, constants)
