"""Measure whether a moving arm stands while it is touched, and the work that is lost.

    python -m lab.moving_arm                                # half an hour
    python -m lab.moving_arm touches --builds 1 --touches 16 --kinds fresh
    python -m lab.moving_arm lost --minutes 1

`touches`: people who are in no set touch the moving arm with 5 N or more in all ways
that people do: gestures, hard grips, and what is no gesture. A weaker touch is made as
strong as that. The arm is suspended once its speed limit is 0, or it is paused or held;
in time is 0.25 s after the first true contact, or after the touch has reached 5 N. An
arm goes on against a hand if it may move again while the same touch truly presses with
1 N or more, whether the skin feels that or not.

`lost`: the arm works while nobody touches it, or while accidents happen at a mean
interval: bumps, brushes and others of the demonstration. What stops it by accident is
ended by the program as soon as the touch is over. Lost is the time for which the arm is
suspended or stopped, and what it takes to reach its speed again. The shares of the time
for which its skin slows it, and for which it is truly touched, are told beside it.

Builds of a family with less than 20 readings a second command no arm: the next seeds
take their place. `--keep` appends a line of JSON for each touch.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Literal, final

import numpy as np
import tyro

from eskin.recording import NONE
from eskin.sim.contact.press import TrueTouch
from eskin.sim.interactive import draw_demo_person
from eskin.sim.sensor.build import BuildKind
from eskin.units import NS_PER_S
from lab.commanded_arm import format_times
from lab.tables import format_head, format_row
from lab.touched_arm import KINDS, TouchedArm, list_seeds

HARD_GRIP = "hard grip"
TOUCHES = (
    "poke",
    "double_pat",
    "grab",
    "stroke",
    HARD_GRIP,
    "lean",
    "bump",
    "resting_hand",
    "press",
    "squeeze_hold",
    "single_pat",
    "guiding",
    "brush",
    "rub",
    "squeeze",
    "tap_many",
)
"""Ways in which people touch a moving arm."""
LEAST_FORCE = 5.0
"""Least greatest force of a touch [N]."""
GRIP_FORCE = 100.0
"""Greatest force of a hard grip [N]."""
IN_TIME = 0.25
"""Longest time until the arm is suspended [s]."""
REACHED = 0.95
"""Share of the least force that counts as that: forces are means over a scan."""
PRESSES = 1.0
"""Force from which a hand is against the arm [N]."""
REST = 1.5
"""Time without touch before each touch [s]."""
LONGEST = 30.0
"""Longest time until the arm moves again before a touch [s]."""
INTERVALS = (None, 20.0, 10.0, 5.0)
"""Mean times from one accident to the next [s]; None is without accidents."""
SPREAD = (0.5, 1.5)
"""Shortest and longest interval, as shares of the mean."""
TOUCH_HEAD = (
    "touch",
    "touches",
    "in 0.25 s",
    "0.25 s after 5 N",
    "suspended",
    "felt",
    "of those suspended",
    "first contact to stand p50 / p95 [s]",
    "went on against it",
    "felt then",
)
LOST_HEAD = (
    "build",
    "accidents every",
    "minutes",
    "accidents",
    "lost",
    "suspended",
    "stopped",
    "reaching its speed",
    "slowed",
    "touched",
)


@dataclass(frozen=True)
class Command:
    """Measure a moving arm that is touched, and the work that is lost."""

    part: tyro.conf.Positional[Literal["touches", "lost", "all"]] = "all"
    """What is measured."""
    builds: int = 4
    """Number of builds of each kind."""
    touches: int = 10
    """Number of touches on each build."""
    minutes: float = 4.0
    """Simulated time of each build and interval of accidents [min]."""
    kinds: tuple[BuildKind, ...] = KINDS
    """Kinds of builds."""
    keep: Path | None = None
    """File to which a line of JSON is appended for each touch."""
    seed: int = 61000
    """Seed of the first build and its people; each kind begins 100 later."""
    workers: int = 1
    """Number of processes."""


@dataclass
class MovingTouch:
    """A touch of a moving arm; times are in [s] since its first true contact."""

    kind: str
    """Kind of the build."""
    seed: int
    """Seed of the build."""
    name: str
    """Way in which it was made."""
    force: float = 0.0
    """Greatest true force on the skin [N]."""
    seconds: float = 0.0
    """Time from first to last contact."""
    reached: float | None = None
    """When it reached the least force of all touches."""
    felt: float | None = None
    """When it was first felt; None where it never was."""
    suspended: float | None = None
    """When the arm was suspended; None where it never was."""
    against: float = 0.0
    """Greatest true force of it while the arm, once suspended, might move again [N]."""
    against_felt: float = 0.0
    """The same in readings in which the skin felt it [N]."""
    detected: list[str] = field(default_factory=list)
    """What it was detected as."""
    decided: list[tuple[str, bool, str]] = field(default_factory=list)
    """What was decided because of it: action, whether it was executed, and why."""

    def is_in_time(self, since: float | None = 0.0) -> bool:
        """Return whether the arm was suspended soon enough after a time [s]."""
        if self.suspended is None or since is None:
            return False
        return self.suspended <= since + IN_TIME


@dataclass(frozen=True)
class LostTime:
    """The time for which an arm did not work as it should, in [s]."""

    kind: BuildKind
    """Kind of the build."""
    interval: float | None
    """Mean time from one accident to the next [s]; None without accidents."""
    seconds: float
    """The whole time."""
    accidents: int
    """Number of accidents."""
    suspended: float
    """Its speed limit was 0."""
    stopped: float
    """It was paused or held."""
    speeding: float
    """It was not at its speed again, as a share of that."""
    slowed: float
    """Its speed limit was less than full speed, but not 0."""
    touched: float
    """It was truly touched."""

    @property
    def lost(self) -> float:
        """Time for which it did not work."""
        return self.suspended + self.stopped + self.speeding


@final
class TouchingPeople:
    """People who touch a moving arm, one after the other."""

    def __init__(self, kind: BuildKind, seed: int) -> None:
        """Begin with an arm that works."""
        self.kind = kind
        self.seed = seed
        self.touched = TouchedArm(kind, seed)
        self.rng = np.random.default_rng([seed, 76])

    def run(self, names: Sequence[str]) -> list[MovingTouch]:
        """Return what touches of some ways did."""
        found = [self.run_touch(number, name) for number, name in enumerate(names)]
        self.touched.close()
        return found

    def draw_touch(self, number: int, name: str) -> TrueTouch:
        """Draw a touch by a person of its own, as strong as it needs to be."""
        hand = self.touched.skin.hand
        person = draw_demo_person(self.touched.skin.env, 1000 * self.seed + number)
        word = "grab" if name == HARD_GRIP else name
        touch = hand.draw_touch(*hand.resolve_kind(word), None, person)
        strongest = sum(press.force.max() for press in touch.presses)
        least = GRIP_FORCE if name == HARD_GRIP else LEAST_FORCE
        scale = max(least / strongest, 1.0)
        presses = tuple(
            replace(press, force=scale * press.force) for press in touch.presses
        )
        return replace(touch, presses=presses)

    def run_touch(self, number: int, name: str) -> MovingTouch:
        """Touch the arm once it moves."""
        touched = self.touched
        touched.go()
        touched.wait(REST)
        touched.wait_until(self.is_working, LONGEST)
        earlier = len(touched.notes.decisions)
        hand = touched.skin.hand
        one = MovingTouch(self.kind, self.seed, name)
        touch = hand.add_performed(self.draw_touch(number, name))
        touched.wait_until(lambda: touched.find_truth(touch) is not None, REST)
        first = touched.stamp
        self.watch(one, touch, first)
        while touch in hand.touching or touched.stamp < first + IN_TIME * NS_PER_S:
            touched.read()
            self.watch(one, touch, first)
        touched.wait(REST)
        felt = touched.notes.felt.get(touch)
        if felt is not None:
            one.felt = (felt - first) / NS_PER_S
        found = touched.notes.list_detections(touch)
        one.detected = [detection.gesture for detection in found]
        one.decided = [
            (event.action, event.accepted, event.why)
            for event in touched.notes.decisions[earlier:]
        ]
        return one

    def watch(self, one: MovingTouch, number: int, first: int) -> None:
        """Note what a touch that began at a stamp does, and the arm [ns]."""
        touched = self.touched
        seconds = (touched.stamp - first) / NS_PER_S
        truth = touched.find_truth(number)
        force = 0.0 if truth is None else truth.force
        if force > 0.0:
            one.seconds = seconds
            one.force = max(one.force, force)
        if one.reached is None and force >= REACHED * LEAST_FORCE:
            one.reached = seconds
        if touched.is_suspended():
            if one.suspended is None:
                one.suspended = seconds
        elif one.suspended is not None:
            one.against = max(one.against, force)
            if number in touched.notes.pressing:
                one.against_felt = max(one.against_felt, force)

    def is_working(self) -> bool:
        """Return whether the arm moves without a limit to its speed."""
        state = self.touched.arm.state()
        return state.moving and not self.touched.is_suspended()


@final
class Accidents:
    """Accidents that happen to an arm at work, and the time that they cost."""

    def __init__(self, kind: BuildKind, seed: int, interval: float | None) -> None:
        """Begin with an arm that works."""
        self.kind: BuildKind = kind
        self.seed = seed
        self.interval = interval
        self.touched = TouchedArm(kind, seed)
        self.rng = np.random.default_rng([seed, 77])
        self.accidents = 0
        self.next_accident = self.draw_next()

    def draw_next(self) -> float:
        """Draw when the next accident begins [ns since the epoch]."""
        if self.interval is None:
            return float("inf")
        wait = self.interval * self.rng.uniform(*SPREAD)
        return self.touched.stamp + wait * NS_PER_S

    def touch(self) -> None:
        """Begin an accident where it is time, by a person of its own."""
        touched = self.touched
        hand = touched.skin.hand
        if touched.stamp < self.next_accident:
            return
        self.next_accident = self.draw_next()
        if hand.touching:
            return
        number = 1000 * self.seed + self.accidents
        hand.perform(NONE, person=draw_demo_person(touched.skin.env, number))
        self.accidents += 1

    def run(self, seconds: float) -> LostTime:
        """Return the time that is lost of some simulated time [s]."""
        touched = self.touched
        period = touched.skin.period
        suspended = stopped = speeding = slowed = pressed = 0.0
        is_late = False
        end = touched.stamp + round(seconds * NS_PER_S)
        while touched.stamp < end:
            self.touch()
            touched.read()
            state = touched.arm.state()
            if state.stopped:
                stopped += period
                is_late = True
                if not touched.skin.hand.touching:
                    touched.go()
            elif state.speed_limit == 0.0:
                suspended += period
                is_late = True
            elif is_late and state.moving:
                scale = touched.arm.executor.trajectory.scale
                missing = max(1.0 - scale / min(state.speed, state.speed_limit), 0.0)
                speeding += missing * period
                is_late = missing > 0.0
            slowed += period * (0.0 < state.speed_limit < 1.0)
            pressed += period * bool(touched.skin.hand.truths())
        touched.close()
        return LostTime(
            kind=self.kind,
            interval=self.interval,
            seconds=seconds,
            accidents=self.accidents,
            suspended=suspended,
            stopped=stopped,
            speeding=speeding,
            slowed=slowed,
            touched=pressed,
        )


TouchPlan = tuple[BuildKind, int, tuple[str, ...]]
"""Kind and seed of a build, and the ways in which it is touched."""
LostPlan = tuple[BuildKind, int, float | None, float]
"""Kind and seed of a build, mean interval of accidents and simulated time [s]."""


def run_touches(plan: TouchPlan) -> list[MovingTouch]:
    """Return what the touches of a build did to the arm."""
    kind, seed, names = plan
    return TouchingPeople(kind, seed).run(names)


def run_accidents(plan: LostPlan) -> LostTime:
    """Return the time that is lost on a build."""
    kind, seed, interval, seconds = plan
    return Accidents(kind, seed, interval).run(seconds)


def format_touches(name: str, touches: Sequence[MovingTouch]) -> str:
    """Format some touches as a row of the table."""
    times = [one.suspended for one in touches if one.suspended is not None]
    felt = [one for one in touches if one.felt is not None]
    quantiles = None
    if times:
        quantiles = float(np.median(times)), float(np.percentile(times, 95))
    return format_row(
        [
            name,
            str(len(touches)),
            str(sum(one.is_in_time() for one in touches)),
            str(sum(one.is_in_time(one.reached) for one in touches)),
            str(len(times)),
            str(len(felt)),
            str(sum(one.suspended is not None for one in felt)),
            format_times(quantiles),
            str(sum(one.against >= PRESSES for one in touches)),
            str(sum(one.against_felt >= PRESSES for one in touches)),
        ]
    )


def measure_touches(command: Command) -> None:
    """Print the table of touches, and each that did not suspend the arm in time."""
    plans: list[TouchPlan] = []
    count = 0
    for kind in command.kinds:
        for seed in list_seeds(kind, command.seed, command.builds):
            numbers = range(count, count + command.touches)
            names = tuple(TOUCHES[number % len(TOUCHES)] for number in numbers)
            count += command.touches
            plans.append((kind, seed, names))
    touches: list[MovingTouch] = []
    with get_context("spawn").Pool(command.workers) as pool:
        for own in pool.imap(run_touches, plans, 1):
            touches += own
            if command.keep is not None:
                with command.keep.open("a", encoding="utf-8") as file:
                    lines = [json.dumps(asdict(one)) + "\n" for one in own]
                    file.writelines(lines)
    print(format_head(TOUCH_HEAD))
    for name in TOUCHES:
        print(format_touches(name, [one for one in touches if one.name == name]))
    for kind in command.kinds:
        print(format_touches(kind, [one for one in touches if one.kind == kind]))
    print(format_touches("all", touches), flush=True)
    for one in touches:
        if not one.is_in_time(one.reached) or one.against >= PRESSES:
            print(f"<!-- {one} -->")


def format_lost(name: str, interval: str, parts: Sequence[LostTime]) -> str:
    """Format the time that is lost on some builds as a row of the table."""
    seconds = sum(part.seconds for part in parts)
    shares = [
        f"{sum(getattr(part, what) for part in parts) / seconds:.1%}"
        for what in ("lost", "suspended", "stopped", "speeding", "slowed", "touched")
    ]
    accidents = sum(part.accidents for part in parts)
    return format_row([name, interval, f"{seconds / 60:.0f}", str(accidents), *shares])


def measure_lost(command: Command) -> None:
    """Print the table of the work that is lost."""
    print("\n" + format_head(LOST_HEAD), flush=True)
    builds: list[tuple[BuildKind, int]] = [
        (kind, seed)
        for kind in command.kinds
        for seed in list_seeds(kind, command.seed, command.builds)
    ]
    with get_context("spawn").Pool(command.workers) as pool:
        for interval in INTERVALS:
            told = "never" if interval is None else f"{interval:g} s"
            seconds = 60.0 * command.minutes
            plans: list[LostPlan] = [(*build, interval, seconds) for build in builds]
            parts = list(pool.imap(run_accidents, plans, 1))
            for kind in command.kinds:
                own = [part for part in parts if part.kind == kind]
                print(format_lost(kind, told, own))
            print(format_lost("all", told, parts), flush=True)


def main(args: list[str] | None = None) -> None:
    """Print the tables."""
    command = tyro.cli(Command, args=args)
    if command.part in ("touches", "all"):
        measure_touches(command)
    if command.part in ("lost", "all"):
        measure_lost(command)


if __name__ == "__main__":
    main()
