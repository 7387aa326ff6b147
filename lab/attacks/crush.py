"""Measure whether a touch that turns into crushing stops a moving arm, and how soon.

    python -m lab.attacks crush                          # 200 events a row, hours
    python -m lab.attacks crush --events 20 --builds fresh

A person strokes, grabs, or touches in a way that is no gesture, with at most 20 N. Once
the touch is detected, or shortly before it would end, the force grows to 150 N. Touches
that are kept instead, with at most 20 N for 2.5 s, tell what the limits cost.

A limit is passed when the measured force of a touch, its growth or its duration exceeds
that of `SkinMonitorConfig`, as this program reads them from the skin. "In time" are the
crushes after which the arm stood within 0.25 s of that; an arm that stands already, for
its gripper, is to be stopped once it moves.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import product
from multiprocessing import get_context
from typing import final

import numpy as np

from eskin.arms import SimulatedArm
from eskin.command import Policy, PolicyConfig, SkinMonitorConfig, load_commands
from eskin.drivers import ManualClock
from eskin.errors import ArmError
from eskin.live import Detection, Recognizer, load_model
from eskin.sim.contact.press import AnyPress, TrueTouch
from eskin.sim.demo import LiveSource
from eskin.sim.demo.headless import SynchronousStream
from eskin.sim.interactive import InteractiveSkin, draw_demo_person
from eskin.sim.interactive.touches import PerformedTouch
from eskin.sim.sensor import FAMILIES
from eskin.sim.sensor.build import BuildKind
from eskin.stream import Context, Listener, Message, Recognition, RecognitionState
from eskin.units import NS_PER_S
from lab.tables import format_head, format_row

BUILDS: tuple[BuildKind, ...] = ("fresh", "shifted", *FAMILIES)
TOUCHES = {
    "stroke": ("stroke",),
    "grab": ("grab",),
    "unknown": ("rub", "squeeze", "press", "resting_hand"),
}
GENTLE = 20.0
CRUSHING = 150.0
"""Greatest force of a touch before, and the force of crushing [N]."""
KEPT_SECONDS = 2.5
"""Duration of a touch that does not crush [s]."""
CRUSH_SECONDS = 3.0
"""Time for which crushing lasts [s]."""
RISE = (0.1, 1.0)
"""Shortest and longest time in which the force grows [s]."""
LIFT = 0.2
"""Time in which it falls at the end [s]."""
LEFT_SHARE = 0.3
"""Share of a touch that is left when it begins to crush, or to be kept."""
REST = 1.2
"""Time without touch before each event [s]."""
TARE = 3.0
"""Time without touch at the start [s]."""
IN_TIME = 0.25
"""Longest time from a limit to the stop [s]."""
HEAD = (
    "build",
    "touch",
    "events",
    "recognised",
    "limit passed",
    "in time",
    "stopped",
    "stays stopped",
    "stop after the begin p50 / p95 [s]",
    "never, measured [N]",
)


@dataclass(frozen=True)
class Command:
    """Measure whether crushing stops a moving arm."""

    events: int = 200
    """Number of events of each row."""
    each: int = 10
    """Number of events of each build and its people."""
    builds: tuple[BuildKind, ...] = BUILDS
    """Kinds of builds."""
    touches: tuple[str, ...] = tuple(TOUCHES)
    """Touches: stroke, grab, unknown."""
    kept: bool = True
    """Whether touches are kept as well."""
    seed: int = 58000
    """Seed of the first build of each row; the others follow."""
    workers: int = 2
    """Number of processes."""


@dataclass(frozen=True)
class Plan:
    """A plan says which events are simulated on one build."""

    build: BuildKind
    touch: str
    crushes: bool
    events: int
    seed: int


@dataclass
class TouchEvent:
    """An event is a touch, what the skin reads of it, and when the arm stands."""

    detected: str = ""
    """What it was first detected as; empty where it was not."""
    began: int | None = None
    """When it began to crush, or to be kept [ns since the epoch]."""
    force: float = 0.0
    """Greatest measured force of a touch since then [N]."""
    passed: int | None = None
    """When a limit was passed since then [ns since the epoch]."""
    stopped: int | None = None
    """When the arm stood since then [ns since the epoch]."""
    is_latched: bool = False
    """Whether the arm was paused or held at the end."""


@final
class EventListener(Listener):
    """Notes what the skin reads of an event, without the policy's own values."""

    name = "event"
    message_types = (Detection, RecognitionState)
    size = 64
    drop = "oldest"

    def __init__(self) -> None:
        """Start before the first event."""
        self.begin()

    def begin(self) -> None:
        """Begin an event."""
        self.event = TouchEvent()
        self.reference: dict[int, float] = {}

    def start(self, context: Context) -> None:
        """Do nothing."""

    def on_message(self, item: Message) -> None:
        """Note a detection, or how strong and long a touch is."""
        limits = SkinMonitorConfig()
        if isinstance(item, Detection):
            self.event.detected = self.event.detected or item.gesture
            self.reference[item.touch] = max(item.peak_force, limits.least_force)
        elif isinstance(item, RecognitionState) and self.event.began is not None:
            stamp = item.state.reading.stamp
            for row in item.state.rows:
                if row.closed or not row.confirmed or row.last < stamp:
                    continue
                grown = limits.max_growth * self.reference.get(row.id, math.inf)
                long = (stamp - row.onset) / NS_PER_S > limits.pause_seconds
                self.event.force = max(self.event.force, row.force)
                if row.force > min(grown, limits.max_force) or long:
                    self.event.passed = self.event.passed or stamp

    def close(self) -> None:
        """Do nothing."""


def stay(
    touch: TrueTouch, at: int, force: float | None, rise: int, last: int, lift: int
) -> TrueTouch:
    """Return a touch that stays in its place from a step of its clock on.

    Args:
        touch: touch on its own clock.
        at: the step.
        force: force that it grows to [N]; None keeps the one of that step.
        rise: number of steps in which it grows.
        last: number of steps for which it stays.
        lift: number of steps in which it then lifts.
    """

    def extend(press: AnyPress) -> AnyPress:
        place = int(np.clip(at - press.first, 1, press.steps))
        before = press.force[place - 1]
        goal = before if force is None else force / len(touch.presses)
        steps = np.array([0, rise, max(last, rise), max(last, rise) + lift])
        times = np.arange(1, steps[-1] + 1)
        added = np.interp(times, steps, [before, goal, goal, 0.0])
        places = np.minimum(np.arange(place + len(added)), place - 1)
        return replace(
            press,
            force=np.concatenate([press.force[:place], added]),
            centre=press.centre[places],
            angle=press.angle[places],
        )

    return replace(touch, presses=tuple(map(extend, touch.presses)))


@final
class CrushedArm:
    """A moving arm in its skin, with the policy, that people touch."""

    def __init__(self, plan: Plan) -> None:
        """Start the arm.

        Raises:
            ArmError: the skin is too slow to command it.
        """
        self.plan = plan
        self.clock = ManualClock(NS_PER_S)
        self.rng = np.random.default_rng([plan.seed, 58])
        self.arm = SimulatedArm(clock=self.clock)
        self.skin = InteractiveSkin("ur5", plan.seed, plan.build)
        model = load_model("ur5")
        mounted = self.skin.mounted
        vocabulary = model.card.vocabulary
        commands = load_commands(None, vocabulary, mounted.skin)
        recognizer = Recognizer(model, mounted, self.skin.calibration)
        self.listener = EventListener()
        self.source = LiveSource(self.skin, self.arm, self.clock)
        policy = Policy(self.arm, commands, vocabulary, PolicyConfig(check_period=None))
        listeners = [self.listener, Recognition(recognizer), policy]
        self.stream = SynchronousStream(self.source, listeners)
        self.step = self.skin.env.constants.value("time.step")

    def read(self) -> int:
        """Read the next scan, and return its stamp."""
        scan = self.source.read()
        assert scan is not None
        self.stream.publish(scan)
        return scan.stamp

    def wait(self, seconds: float) -> None:
        """Read scans for a time [s]."""
        end = self.source.due + round(seconds * NS_PER_S)
        while self.read() < end:
            pass

    def draw_touch(self, number: int) -> TrueTouch:
        """Draw a touch by a person of its own, with at most the gentle force."""
        hand = self.skin.hand
        word = str(self.rng.choice(TOUCHES[self.plan.touch]))
        person = draw_demo_person(self.skin.env, 1000 * self.plan.seed + number)
        touch = hand.draw_touch(*hand.resolve_kind(word), None, person)
        strongest = max(sum(press.force.max() for press in touch.presses), GENTLE)
        presses = tuple(
            replace(press, force=GENTLE / strongest * press.force)
            for press in touch.presses
        )
        return replace(touch, presses=presses)

    def extend_touch(self, touch: TrueTouch, at: int) -> TrueTouch:
        """Return a touch that crushes, or is kept, from a step of its clock on."""
        lift = round(LIFT / self.step)
        if not self.plan.crushes:
            left = max(round(KEPT_SECONDS / self.step) - at - lift, 1)
            return stay(touch, at, None, 1, left, lift)
        rise = round(self.rng.uniform(*RISE) / self.step)
        last = round(CRUSH_SECONDS / self.step)
        return stay(touch, at, CRUSHING, rise, last, lift)

    def perform(self, number: int) -> TouchEvent:
        """Perform an event on the moving arm."""
        self.arm.release()
        self.arm.resume()
        self.wait(REST)
        self.listener.begin()
        event = self.listener.event
        first = self.source.due
        performed = PerformedTouch(self.draw_touch(number), 0.1, self.skin.env)
        latest = round((1 - LEFT_SHARE) * performed.end)
        self.skin.hand.add_touch(performed)
        while not performed.over:
            stamp = self.read()
            at = round(((stamp - first) / NS_PER_S + self.skin.period) / self.step)
            is_due = at >= latest or (self.plan.crushes and event.detected)
            if event.began is None and is_due:
                event.began = stamp
                performed.touch = self.extend_touch(performed.touch, at)
                ends = [press.first + press.steps for press in performed.touch.presses]
                performed.end = max(ends)
                performed.over = False
            state = self.arm.state()
            stands = state.stopped or state.speed_limit == 0.0
            if event.began and stands:
                event.stopped = event.stopped or stamp
            elif event.passed and not state.moving:
                event.passed = stamp
        event.is_latched = self.arm.state().stopped
        return event


def run_events(plan: Plan) -> list[TouchEvent]:
    """Simulate the events of a plan; none where its skin is too slow for an arm."""
    try:
        crushed = CrushedArm(plan)
    except ArmError:
        return []
    crushed.wait(TARE)
    events = [crushed.perform(number) for number in range(plan.events)]
    crushed.stream.close()
    return events


def format_crushes(plan: Plan, events: list[TouchEvent]) -> str:
    """Format a row of the table of crushes."""
    late = [e for e in events if e.passed and not is_in_time(e)]
    passed = [event for event in events if event.passed]
    delays = [
        (event.stopped - event.began) / NS_PER_S
        for event in events
        if event.stopped and event.began
    ]
    times = np.percentile(delays, [50, 95]) if delays else [math.nan] * 2
    never = [f"{event.force:.0f}" for event in events if event.stopped is None]
    recognised = sum(event.detected in TOUCHES for event in events)
    cells = [plan.build, plan.touch, len(events), recognised, len(passed)]
    cells += [len(passed) - len(late), len(delays)]
    cells += [sum(event.is_latched for event in events)]
    cells += ["{:.2f} / {:.2f}".format(*times), ", ".join(never) or "none"]
    return format_row([str(cell) for cell in cells])


def is_in_time(event: TouchEvent) -> bool:
    """Return whether the arm stood soon after a limit was passed, if one was."""
    if event.passed is None:
        return True
    latest = event.passed + round(IN_TIME * NS_PER_S)
    return event.stopped is not None and event.stopped <= latest


def simulate(command: Command, crushes: bool) -> Iterator[tuple[Plan, list]]:
    """Yield each row of a table: a plan, and its events on all builds."""
    with get_context("spawn").Pool(command.workers) as pool:
        for build, touch in product(command.builds, command.touches):
            plan = Plan(build, touch, crushes, command.each, command.seed)
            count = math.ceil(command.events / command.each)
            plans = [replace(plan, seed=plan.seed + number) for number in range(count)]
            found = pool.imap(run_events, plans, 1)
            yield plan, [event for events in found for event in events]


def main(command: Command) -> None:
    """Print the table of crushes, then the table of touches that are kept."""
    print(format_head(HEAD), flush=True)
    for plan, events in simulate(command, True):
        print(format_crushes(plan, events), flush=True)
    if not command.kept:
        return
    print("\n" + format_head(["build", "kept touch", "events", "ended in a stop"]))
    for plan, events in simulate(command, False):
        latched = sum(event.is_latched for event in events)
        cells = [plan.build, plan.touch, str(len(events)), str(latched)]
        print(format_row(cells), flush=True)
