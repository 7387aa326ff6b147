"""Rest hands on an arm for a minute, and switch a skin on under a hand.

    python -m lab.flaws rest                # the long form
    python -m lab.flaws rest --builds 3     # a quick look

Three hands, a palm or four fingers that press evenly, land on three links and rest for
60 s, at 1.5, 3 and 10 times the activation pressure under them (at least 2 kPa). The
sensor creeps: conductance grows by 10 % from 1 s to 60 s under load. The force of a
still hand does not vary, or by 6 or 12 % (standard deviation; people vary by 2 to 12 %,
median 6). Its other flaws are none, or all typical. The first table has how many hands
are touches 3 s after landing, how many still are at the end, and how many of these are
the same touch all the time.

In the second table the skin is switched on under a hand that rests, which lifts 5 s
later. One second after it, a finger presses there. It is right if the touch has the
onset within 0.1 s, the place within 10 mm and the peak force within 20 % of what the
same skin says if it was switched on untouched.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, product
from multiprocessing import get_context

import numpy as np
from jaxtyping import Int

from eskin.live import load_model
from eskin.sim.interactive.skin import round_period
from eskin.sim.scene.environment import SimEnvironment, load_environment
from eskin.sim.scene.poses import POSE_GROUPS, draw_pose
from eskin.sim.sensor import FAMILIES, SensorBuild, draw_flawed_build
from eskin.sim.sensor.flaws import Family
from eskin.skin import Skin
from eskin.touch import Touch, TouchPipeline
from eskin.units import NS_PER_S
from lab.flaws.hands import (
    LANDING,
    SHAPES,
    Hand,
    PressedSensor,
    compute_hand_pressure,
    draw_block,
    set_creep,
)
from lab.flaws.report import format_share
from lab.flaws.stream import ALL, FLAWED, INTACT
from lab.tables import format_head, format_row

PATCHES = ("upper_arm_back", "forearm_front", "wrist_2")
"""Patches that hands rest on, each of another link."""
FACTORS = (1.5, 3.0, 10.0)
SWAYS = (0.0, 0.06, 0.12)
QUIET = 5.0
BETWEEN = 1.5
RESTING = 60.0
"""Time before the first hand, from one to the next, and for which each rests [s]."""
FELT_AFTER = 3.0
"""Time after landing at which a hand is a touch [s]."""
CREEP = 0.1
SWITCHED_ON = 5.0
PAUSE = 1.0
PRESS = 0.6
"""Time that a hand rests after the skin is switched on, until the next press, and the
duration of that [s]."""
FINGER = 4
"""Number of taxels that a finger presses."""
PRESS_FACTOR = 5.0
"""Pressure of that press, by activation pressure."""
NEAR = 0.010
FORCE_SHARE = 0.2
ONSET_SECONDS = 0.1
APART = 0.2
"""Least distance between two hands [m]."""
LATEST = 0.1
"""Time since the last contact up to which a touch is there [s]."""


@dataclass(frozen=True)
class Command:
    """Rest hands on an arm, and switch a skin on under a hand."""

    builds: int = 34
    """Builds of each row; each has three hands, with each pressure once."""
    starts: int = 30
    """Builds of each row of the second table."""
    flaws: tuple[str, ...] = (INTACT, ALL)
    """Flaws of the builds besides creep, names of rows of `touches`."""
    families: tuple[Family, ...] = FAMILIES
    """Families of sensors."""
    seed: int = 0
    """Random seed."""
    workers: int = 2
    """Number of processes."""


@dataclass(frozen=True)
class RestPlan:
    """A plan says on which build hands rest, and how still they are."""

    family: Family
    flaws: str
    sway: float
    number: int
    seed: int


@dataclass(frozen=True)
class HandResult:
    """Says whether one hand was a touch."""

    factor: float
    felt: bool
    """Whether it was a touch after some seconds."""
    held: bool
    """Whether it was one at the end."""
    same: bool
    """Whether these were the same touch."""


@dataclass(frozen=True)
class StartResult:
    """Says how the first touch was found after a skin was switched on under a hand."""

    closed: bool
    """Whether no touch was open before it."""
    onset: bool
    place: bool
    force: bool
    ratio: float
    """Its force by that of a skin that was switched on untouched; NaN without touch."""

    @property
    def right(self) -> bool:
        """Tell whether all of it is right."""
        return self.onset and self.place and self.force


def build_creeping(plan: RestPlan, env: SimEnvironment) -> SensorBuild:
    """Draw the build of a plan."""
    rng = np.random.default_rng((plan.seed, plan.number, 30))
    build = draw_flawed_build(
        f"rest-b{plan.number}",
        plan.family,
        FLAWED[plan.flaws],
        env.mounted.skin,
        env.constants,
        rng,
    )
    return set_creep(round_period(build), CREEP, 1.0, RESTING)


def find_touch(touches: Sequence[Touch], hand: Hand, now: int) -> Touch | None:
    """Return the touch that a hand is part of; None without one."""
    for touch in touches:
        recent = now - touch.last <= LATEST * NS_PER_S
        if recent and np.isin(touch.contact.taxels, hand.taxels).any():
            return touch
    return None


def draw_hands(
    plan: RestPlan, build: SensorBuild, env: SimEnvironment, rng: np.random.Generator
) -> tuple[np.ndarray, list[Hand]]:
    """Draw a pose and the three hands of a build, apart from each other."""
    skin = env.mounted.skin
    while True:
        q = draw_pose(env, POSE_GROUPS, rng)
        shapes = [str(rng.choice(list(SHAPES))) for _ in PATCHES]
        blocks = [
            draw_block(shape, patch, skin, rng)
            for shape, patch in zip(shapes, PATCHES, strict=True)
        ]
        places, _ = env.mounted.place_taxels(q)
        gaps = [
            np.linalg.norm(places[one][:, None] - places[other], axis=2).min()
            for one, other in combinations(blocks, 2)
        ]
        if min(gaps) > APART:
            break
    hands = []
    for number, taxels in enumerate(blocks):
        factor = FACTORS[(number + plan.number) % len(FACTORS)]
        lands = QUIET + BETWEEN * number
        pressure = compute_hand_pressure(factor, taxels, build)
        hands.append(Hand(taxels, pressure, lands, lands + LANDING + RESTING))
    return q, hands


def rest_hands(plan: RestPlan) -> list[HandResult]:
    """Rest three hands on one build."""
    env = load_environment("ur5")
    build = build_creeping(plan, env)
    rng = np.random.default_rng((plan.seed, plan.number, 31))
    q, hands = draw_hands(plan, build, env, rng)
    skin = env.mounted.skin
    stream = PressedSensor(build, skin, hands, plan.sway, plan.number)
    config = load_model("ur5").card.pipeline
    pipeline = TouchPipeline(env.mounted, build.calibration(skin), config)
    felt: dict[int, int | None] = {}
    held: dict[int, int | None] = {}
    while len(held) < len(hands):
        state = pipeline.push_scan(stream.scan(q))
        for number, hand in enumerate(hands):
            is_felt = stream.time >= hand.lands + FELT_AFTER
            is_held = stream.time >= hand.lifts
            for found, is_due in ((felt, is_felt), (held, is_held)):
                if is_due and number not in found:
                    touch = find_touch(state.touches, hand, state.reading.stamp)
                    found[number] = touch.id if touch else None
    return [
        HandResult(
            FACTORS[(number + plan.number) % len(FACTORS)],
            felt[number] is not None,
            held[number] is not None,
            held[number] is not None and held[number] == felt[number],
        )
        for number in range(len(hands))
    ]


@dataclass(frozen=True)
class FoundPress:
    """What the pipeline said of the press after a hand lifted."""

    open_before: int
    """Number of open touches shortly before it."""
    onset: int
    peak_force: float
    p_world: tuple[float, ...]


def find_press(
    build: SensorBuild,
    env: SimEnvironment,
    hands: Sequence[Hand],
    q: np.ndarray,
    seed: int,
) -> FoundPress:
    """Play hands to a new pipeline; say what it makes of the last of them."""
    skin = env.mounted.skin
    stream = PressedSensor(build, skin, hands, 0.06, seed, before=3.0)
    config = load_model("ur5").card.pipeline
    pipeline = TouchPipeline(env.mounted, build.calibration(skin), config)
    press = hands[-1]
    best: Touch | None = None
    open_before = 0
    while stream.time < press.lifts + LANDING:
        state = pipeline.push_scan(stream.scan(q))
        if stream.time < press.lands:
            open_before = len(state.open)
            continue
        touch = find_touch(state.touches, press, state.reading.stamp)
        if touch and (best is None or touch.contact.force > best.contact.force):
            best = touch
    if best is None:
        return FoundPress(open_before, 0, float("nan"), (np.nan,) * 3)
    place = tuple(best.contact.p_world.tolist())
    return FoundPress(open_before, best.onset, best.contact.force, place)


def choose_finger(
    taxels: Int[np.ndarray, "pressed"], skin: Skin
) -> Int[np.ndarray, "some"]:
    """Return the taxels in the middle of a hand that a finger presses."""
    places = skin.positions[taxels]
    gaps = np.linalg.norm(places - places[len(taxels) // 2], axis=1)
    return taxels[np.argsort(gaps, kind="stable")[:FINGER]]


def start_under_hand(plan: RestPlan) -> StartResult:
    """Switch a build on under a hand; compare what follows to an untouched start."""
    env = load_environment("ur5")
    build = build_creeping(plan, env)
    rng = np.random.default_rng((plan.seed, plan.number, 32))
    q = draw_pose(env, POSE_GROUPS, rng)
    patch = str(rng.choice(PATCHES))
    shape = str(rng.choice(list(SHAPES)))
    taxels = draw_block(shape, patch, env.mounted.skin, rng)
    factor = float(rng.choice(FACTORS))
    resting = Hand(
        taxels, compute_hand_pressure(factor, taxels, build), -2.5, SWITCHED_ON
    )
    lands = SWITCHED_ON + LANDING + PAUSE
    finger = choose_finger(taxels, env.mounted.skin)
    pressed = compute_hand_pressure(PRESS_FACTOR, finger, build)
    press = Hand(finger, pressed, lands, lands + LANDING + PRESS)
    away = replace(resting, pressure=0.0)
    after = find_press(build, env, (resting, press), q, plan.number)
    usual = find_press(build, env, (away, press), q, plan.number)
    late = (after.onset - usual.onset) / NS_PER_S
    apart = float(np.linalg.norm(np.subtract(after.p_world, usual.p_world)))
    ratio = after.peak_force / usual.peak_force
    return StartResult(
        closed=after.open_before == 0,
        onset=bool(np.isfinite(ratio)) and abs(late) <= ONSET_SECONDS,
        place=apart <= NEAR,
        force=abs(ratio - 1.0) <= FORCE_SHARE,
        ratio=ratio,
    )


def plan_rows(command: Command, sways: Sequence[float]) -> Iterator[RestPlan]:
    """Yield one plan for each row, with build 0."""
    for flaws, family, sway in product(command.flaws, command.families, sways):
        yield RestPlan(family, flaws, sway, 0, command.seed)


REST_HEAD = ("family", "other flaws", "sway")
START_HEAD = (
    "switched on under a hand",
    "other flaws",
    "no touch open before",
    "onset",
    "place",
    "force",
    "all right",
    "force, 10/50/90 %",
    "presses",
)


def print_rest(command: Command) -> None:
    """Print the table of hands that rest."""
    cells = [f"{f:g} x, {what}" for f in FACTORS for what in ("felt", "at the end")]
    print(format_head([*REST_HEAD, *cells, "the same touch", "hands"]))
    with get_context("spawn").Pool(command.workers) as pool:
        for row in plan_rows(command, SWAYS):
            plans = [replace(row, number=n) for n in range(command.builds)]
            hands = [hand for found in pool.map(rest_hands, plans, 1) for hand in found]
            cells = [row.family, row.flaws, f"{100 * row.sway:.0f} %"]
            for factor in FACTORS:
                some = [hand for hand in hands if hand.factor == factor]
                cells.append(format_share(hand.felt for hand in some))
                cells.append(format_share(hand.held for hand in some))
            cells.append(format_share(hand.same for hand in hands if hand.held))
            print(format_row([*cells, str(len(hands))]), flush=True)


def print_starts(command: Command) -> None:
    """Print the table of skins that are switched on under a hand."""
    print("\n" + format_head(START_HEAD))
    with get_context("spawn").Pool(command.workers) as pool:
        for row in plan_rows(command, (0.06,)):
            plans = [replace(row, number=n) for n in range(command.starts)]
            found = pool.map(start_under_hand, plans, 1)
            ratios = [one.ratio for one in found if np.isfinite(one.ratio)]
            spread = np.percentile(ratios, [10, 50, 90]) if ratios else []
            cells = [
                row.family,
                row.flaws,
                *(
                    format_share(getattr(one, name) for one in found)
                    for name in ("closed", "onset", "place", "force", "right")
                ),
                "/".join(f"{part:.2f}" for part in spread),
                str(len(found)),
            ]
            print(format_row(cells), flush=True)


def main(command: Command) -> None:
    """Print both tables."""
    print_rest(command)
    print_starts(command)
