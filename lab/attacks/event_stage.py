"""This module lets events take place on a simulated skin, and tells policies."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, final
from zlib import crc32

import numpy as np
from jaxtyping import Float, Int

from eskin.arms import FRAME_TASK, SimulatedArm
from eskin.command import Arm, Policy, PolicyConfig, load_commands
from eskin.drivers import ManualClock, SourceInfo
from eskin.live import Model, Recognizer
from eskin.sim.contact.press import ContactSite, TrueTouch
from eskin.sim.interactive import InteractiveSkin
from eskin.sim.interactive.skin import draw_demo_person
from eskin.sim.scene.scene import (
    TouchScene,
    compute_scene_pressure,
    compute_touch_presses,
)
from eskin.sim.sensor.build import BuildKind
from eskin.stream import CommandEvent, Context, RecognitionState
from eskin.touch import Scan
from eskin.units import NS_PER_S
from lab.attacks.event_draws import STEP, EventDraw, Happening, Pulses, World
from lab.attacks.event_streams import PAUSED_NOW
from lab.attacks.event_trace import TraceWriter, read_trace
from lab.attacks.skin_faults import build_target

MIN_RATE = 20.0
"""Least number of readings a second for an arm to be commanded."""
SLOTS = 3
"""Largest number of events at once."""
APART = 0.3
"""Least distance between them [m]."""
LEAD = 0.1
"""Time before the first contact of an event [s]."""
TAIL = 2.2
"""Time after its last contact, in which a question may be open and answered [s]."""
WARM_UP = 1.0
"""Time in which the recogniser learns the baseline before each event [s]."""
PAUSED_FOR = 3.0
"""Time for which the paused arm has been paused before an event [s]."""
PERSON_EVENTS = 5
"""Number of events by one person."""
CONTACTS = 22.0
"""Counts at which contact begins, on the converter of `build_target`."""
ARMS = ("paused", "slow", "working")
"""Arms that each event meets."""
Line = dict[str, Any]
"""Kept record of an event."""
Disturbance = Callable[[float], Float[np.ndarray, "taxel"]]
"""Gives the change of the counts at a time after the start of an event [s]."""


@dataclass(frozen=True)
class Setup:
    """A setup says what recognises touches, and by which rules they command an arm."""

    model: Model
    """Model of the recogniser."""
    map: Path | None
    """Command map: a file, or `paper`; None is the default one."""
    config: PolicyConfig
    """How careful the policies are."""


@final
class Slot:
    """A slot is one event, with its arms and what their policies decide.

    Attributes:
        decisions: decisions of the policy of each arm, by its name.
        detections: gesture, confidence and time since the start of each detection [s].
    """

    def __init__(
        self, row: str, info: SourceInfo, build: Callable[[Arm], Policy], now: int
    ) -> None:
        """Begin before an event.

        Args:
            row: name of its row.
            info: describes the skin.
            build: builds the policy of an arm.
            now: time [ns since the epoch].
        """
        self.start = now
        self.decisions: dict[str, list[CommandEvent]] = {name: [] for name in ARMS}
        self.detections: list[tuple[str, float, float]] = []
        self.policies: list[Policy] = []
        before = 0.0 if row in PAUSED_NOW else PAUSED_FOR
        self.clock = ManualClock(now - round(before * NS_PER_S))
        for name in ARMS:
            arm = SimulatedArm(clock=self.clock)
            if name == "paused":
                arm.pause()
            elif name == "slow":
                arm.set_speed(0.3)
            policy = build(arm)
            publish = self.decisions[name].append
            policy.start(Context(info, self.clock, publish))  # type: ignore[arg-type]
            policy.check_skin()
            self.policies.append(policy)
        self.clock.time = now

    def push(self, recognition: RecognitionState) -> None:
        """Tell the policies of a reading."""
        self.clock.time = recognition.state.reading.stamp
        for one in recognition.detections:
            seconds = (one.stamp - self.start) / NS_PER_S
            self.detections.append((one.gesture, round(one.confidence, 4), seconds))
        for policy in self.policies:
            for detection in recognition.detections:
                policy.on_message(detection)
            policy.on_message(recognition)

    def conclude(self) -> Line:
        """Return what the policies decided, in terms of JSON."""
        return {
            "decided": {
                name: [
                    [
                        one.action,
                        one.gesture,
                        one.accepted,
                        one.why,
                        (one.stamp - self.start) / NS_PER_S,
                    ]
                    for one in some
                ]
                for name, some in self.decisions.items()
            },
            "detections": [list(one) for one in self.detections],
        }


def select_touches(recognition: RecognitionState, ids: set[int]) -> RecognitionState:
    """Return the reports of some touches alone."""
    state = recognition.state
    tracking = state.tracking
    part = replace(
        state,
        tracking=tracking._replace(
            open=tuple(one for one in tracking.open if one.id in ids),
            closed=tuple(one for one in tracking.closed if one.id in ids),
            held=tuple(one for one in tracking.held if one.id in ids),
        ),
    )
    chances = {i: p for i, p in recognition.probabilities.items() if i in ids}
    said = tuple(one for one in recognition.detections if one.touch in ids)
    return RecognitionState(part, chances, said)


@final
class Stage:
    """A stage is one build of a skin on a still robot, on which events take place.

    Up to three events take place at once, 0.3 m apart. The policies of each are told
    only of the touches that are nearest to it.
    """

    def __init__(self, kind: BuildKind, seed: int, setup: Setup) -> None:
        """Build the skin; the first seed from the given one that is fast enough."""
        self.setup = setup
        self.seed = seed
        while True:
            self.skin = InteractiveSkin("ur5", seed, kind)
            if 1.0 / self.skin.period >= MIN_RATE:
                break
            seed += 1000
        waypoints = FRAME_TASK.waypoints
        self.q = np.array(waypoints[seed % len(waypoints)].q, np.float64)
        self.skin.hand.q = self.q
        self.period = round(self.skin.period * NS_PER_S)
        self.now = NS_PER_S
        self.target = build_target(self.skin.mounted.skin, self.skin.calibration, seed)
        self.mounted = self.skin.mounted
        self.words = setup.model.card.vocabulary
        self.commands = load_commands(
            setup.map, self.words, self.mounted.skin, simulated=True
        )
        calibration = self.skin.calibration
        rate = 1.0 / self.skin.period
        self.info = SourceInfo("sim:events", self.mounted, calibration, rate)

    def build_policy(self, arm: Arm) -> Policy:
        """Build the policy of an arm."""
        return Policy(arm, self.commands, self.words, self.setup.config)

    def run_row(
        self, row: str, world: World, events: int, keeps: bool
    ) -> Iterator[Line]:
        """Yield the kept record of each event of a row.

        Args:
            row: name of the row.
            world: draws its events.
            events: number of events.
            keeps: whether lines have traces, from which policies can be told again.
        """
        self.rng = self.build_rng(row)
        people: list[int] = []
        drawn = 0
        while events > 0:
            some: list[Happening] = []
            for _ in range(4 * min(SLOTS, events)):
                if len(some) == min(SLOTS, events):
                    break
                if drawn // PERSON_EVENTS == len(people):
                    people.append(int(self.rng.integers(1 << 31)))
                person = draw_demo_person(self.skin.env, people[-1])
                event = world(EventDraw(self.skin, self.q, person, self.rng))
                if all(self.are_apart(event, other) for other in some):
                    drawn += 1
                    some.append(event)
            yield from self.play(row, some, keeps)
            events -= len(some)

    def build_rng(self, row: str) -> np.random.Generator:
        """Build the generator of a row; each kind of builds has events of its own."""
        name = f"{self.skin.build.kind} {row}"
        return np.random.default_rng([self.seed, 58, crc32(name.encode())])

    def are_apart(self, event: Happening, other: Happening) -> bool:
        """Return whether two events are far enough from each other."""
        gaps = self.find_places(event)[:, None] - self.find_places(other)[None]
        return bool(np.linalg.norm(gaps, axis=2).min() >= APART)

    def find_places(self, event: Happening) -> Float[np.ndarray, "site 3"]:
        """Return where an event takes place in the world [m]."""
        return np.stack([self.find_place(site) for site in event.sites])

    def find_place(self, site: ContactSite) -> Float[np.ndarray, "3"]:
        """Return where a site is in the world [m]."""
        env = self.skin.env
        point = env.charts[site.chart].surface.wrap(np.array([site.centre]))
        T = env.poses(self.q)[env.links[site.chart]]
        return T[:3, :3] @ point.positions[0] + T[:3, 3]

    def find_owners(self, events: list[Happening]) -> Int[np.ndarray, "taxel"]:
        """Return the nearest event of each taxel."""
        skin = self.mounted.skin
        robot = self.mounted.robot
        links = np.array([robot.link_index(patch.link) for patch in skin.patches])
        T = self.skin.env.poses(self.q)[links[np.asarray(skin.patch_index)]]
        world = np.einsum("tij,tj->ti", T[:, :3, :3], skin.positions) + T[:, :3, 3]
        gaps = [
            np.linalg.norm(world[:, None] - self.find_places(event), axis=2).min(axis=1)
            for event in events
        ]
        return np.argmin(gaps, axis=0)

    def scan(self, events: list[Happening], readings: int) -> Iterator[Scan]:
        """Simulate readings, in which events begin after the lead."""
        skin = self.skin
        step = skin.build.electronics.step
        lead = round(LEAD / step)
        touches = tuple(
            TrueTouch(
                "none",
                "",
                "",
                tuple(replace(one, first=one.first + lead) for one in event.presses),
                {},
            )
            for event in events
        )
        scene = TouchScene(np.tile(self.q, (readings * skin.steps, 1)), touches)
        presses = compute_touch_presses(scene, skin.env)
        pressure, taxels = compute_scene_pressure(
            presses, scene.steps, skin.build.film_sigma, self.mounted.skin
        )
        disturbed = [
            self.build_disturbance(one) for event in events for one in event.pulses
        ]
        done = 0
        while done < readings:
            some = min(readings - done, skin.sensor.noise.remaining)
            part = slice(done * skin.steps, (done + some) * skin.steps)
            before = skin.sensor.steps
            skin.sensor.simulate_steps(pressure[part], taxels)
            places = before - 1.0 + skin.steps * np.arange(1, some + 1)
            for counts in skin.sensor.read(places):
                lost = skin.sensor.losses.draw_next()[0] & (done * step > LEAD)
                received = ~lost[self.mounted.skin.patch_index]
                seconds = done * skin.period - LEAD
                added = sum(disturb(seconds) for disturb in disturbed)
                counts = np.round(counts + added).astype(counts.dtype)
                counts = np.clip(counts, 0, self.target.full_scale)
                counts[~received] = 0
                self.now += self.period
                done += 1
                yield Scan(self.now, counts, received, self.q)

    def build_disturbance(self, pulses: Pulses) -> Disturbance:
        """Return what pulses add to the counts at a time after the start [s]."""
        skin = self.mounted.skin
        chart = self.skin.env.charts[pulses.site.chart]
        away = np.linalg.norm(chart.unrolled - pulses.site.centre, axis=1)
        near = chart.taxels[away <= max(pulses.reach, away.min())]
        first = chart.taxels[np.argmin(away)]
        if pulses.where != "near":
            near = near[skin.patch_index[near] == skin.patch_index[first]]
        if pulses.where == "row":
            near = near[skin.rows[near] == skin.rows[first]]
        size = np.zeros(skin.count)
        size[near] = self.rng.uniform(0.4, 1.0, len(near))
        size *= self.target.unit * CONTACTS

        def disturb(seconds: float) -> Float[np.ndarray, "taxel"]:
            place = int(np.floor(seconds / STEP)) - pulses.first
            level = pulses.level[place] if 0 <= place < len(pulses.level) else 0.0
            noise = self.rng.normal(1.0, pulses.noise, skin.count)
            return level * size * noise

        return disturb

    def play(self, row: str, events: list[Happening], keeps: bool) -> list[Line]:
        """Let events of a row take place at once; return the kept record of each."""
        recognizer = Recognizer(self.setup.model, self.mounted, self.skin.calibration)
        for scan in self.scan([], round(WARM_UP / self.skin.period)):
            recognizer.push(scan)
        slots = [Slot(row, self.info, self.build_policy, self.now) for _ in events]
        writers = [TraceWriter(self.now) for _ in events if keeps]
        owners = self.find_owners(events)
        ids: list[set[int]] = [set() for _ in slots]
        seconds = LEAD + max(event.seconds for event in events) + TAIL
        for scan in self.scan(events, round(seconds / self.skin.period)):
            detections = tuple(recognizer.push(scan))
            state = recognizer.state
            assert state is not None
            told = RecognitionState(state, recognizer.probabilities, detections)
            for touch in state.rows:
                if len(touch.taxels) and not any(touch.id in some for some in ids):
                    owner = int(np.bincount(owners[touch.taxels]).argmax())
                    ids[owner].add(touch.id)
            parts = [select_touches(told, own) for own in ids]
            for slot, part in zip(slots, parts, strict=True):
                slot.push(part)
            for writer, part in zip(writers, parts, strict=False):
                writer.push(part)
        lines = [slot.conclude() for slot in slots]
        for line, writer in zip(lines, writers, strict=False):
            line["trace"] = writer.finish()
        return lines

    def replay(self, row: str, trace: str) -> Line:
        """Tell policies of an event again; return what they decide now."""
        start, readings = read_trace(trace, self.mounted)
        slot = Slot(row, self.info, self.build_policy, start)
        for recognition in readings:
            slot.push(recognition)
        return slot.conclude()
