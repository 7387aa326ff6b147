"""Count the events of things and people that start, speed up or stop an arm.

    python -m lab.attacks events                       # fresh builds, half an hour
    python -m lab.attacks events --events 40 --only bounce grab --keep kept.jsonl
    python -m lab.attacks events --map commands.yaml   # with another command map
    python -m lab.attacks events --kept kept.jsonl     # rules on what was kept

Every event meets three arms, each with a policy of its own: one was paused long ago (or
as the event begins, in `swings on after a pause`), one works slowly, one at full speed.
The simulated robot stands still in all three. Up to three events take place at once,
0.3 m apart; each policy is told only of the touches that are nearest to its own event.
A row has the numbers of events after which the paused arm was resumed or jogged, the
slow one sped up, the working one made to do more, and stopped, even for a moment.

What is kept has a line for each event: what its arms were told, and for each touch its
detections, final probabilities and features that a rule could use. The same command
goes on where it was interrupted, by the file that it keeps. `--kept` prints the share
of the events of each row in which some touch meets each of `RULES`.
"""

import json
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TextIO, final

import numpy as np
from jaxtyping import Float, Int

from eskin.command import (
    FRAME_TASK,
    STARTING_ACTIONS,
    SUSPEND,
    Policy,
    PolicyConfig,
    load_commands,
)
from eskin.command.commanded_touch import compute_breadth
from eskin.command.evidence import EvidenceConfig, EvidenceMonitor
from eskin.drivers import ManualClock, SourceInfo
from eskin.live import Detection, Recognizer, load_model
from eskin.sim.arm import SimulatedArm
from eskin.sim.contact.press import TrueTouch
from eskin.sim.interactive import InteractiveSkin
from eskin.sim.interactive.skin import draw_demo_person
from eskin.sim.scene.scene import (
    TouchScene,
    compute_scene_pressure,
    compute_touch_presses,
)
from eskin.sim.sensor.build import BuildKind
from eskin.stream import CommandEvent, Context, RecognitionState
from eskin.touch import Scan, TouchRecord, TouchState
from eskin.units import NS_PER_S
from lab.attacks.event_worlds import THINGS, WORLDS, EventDraw, Happening
from lab.attacks.skin_faults import build_target
from lab.tables import format_head, format_row

MIN_RATE = 20.0
"""Least number of readings a second for an arm to be commanded."""
SLOTS, APART = 3, 0.3
"""Number of events at once, and the least distance between them [m]."""
LEAD, TAIL, WARM_UP = 0.1, 0.7, 1.0
"""Time before the first and after the last contact, and before the first event [s]."""
PAUSED_FOR = 3.0
"""Time for which the paused arm has been paused before an event [s]."""
PERSON_EVENTS = 5
"""Number of events by one person."""
PAUSED_NOW = "swings on after a pause"
"""Row in which the arm is paused only as the event begins."""
ARMS = ("paused", "slow", "working")
HEAD = ("row", "events", "starts", "sped up", "moved on", "stopped", "detected")
Lines = list[dict[str, Any]]
"""What is kept of events."""


@dataclass(frozen=True)
class Command:
    """Count the events that start, speed up or stop an arm."""

    events: int = 200
    """Number of events of each row."""
    kinds: tuple[BuildKind, ...] = ("fresh",)
    """Kinds of builds; each row is run on each."""
    builds: int = 4
    """Number of builds of each kind that share the events of a row."""
    only: tuple[str, ...] = ()
    """Parts of the names of the rows; by default all."""
    map: Path | None = None
    """Command map: a file, or `paper`; the default one unless given."""
    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""
    keep: Path | None = None
    """File to which a line of JSON is appended for each event; rows of builds that it
    has are not simulated again."""
    kept: tuple[Path, ...] = ()
    """Such files, on which rules are tried; nothing is simulated."""
    seed: int = 40000
    """Seed of the first build, its events and people."""


@dataclass
class TouchFeatures:
    """These are the features of a touch that a rule could use."""

    onset: int
    last: int
    runs: list[list[int]] = field(default_factory=list)
    taxels: list[int] = field(default_factory=list)
    force: list[float] = field(default_factory=list)
    breadth: list[float] = field(default_factory=list)
    area: float = 0.0
    peak: float = 0.0
    spread: float = 0.0
    since: float | None = None
    plausible: bool = False
    merged: bool = False
    detections: list[Detection] = field(default_factory=list)
    chances: dict[str, float] = field(default_factory=dict)

    def summarise(self, start: int) -> dict[str, Any]:
        """Return them in a form that is kept; times are since the event began [s]."""
        lengths = [(end - begin) / NS_PER_S for begin, end in self.runs]
        force = np.array(self.force)
        middle = force[len(force) // 4 : max(3 * len(force) // 4, 1)]
        return {
            "onset": (self.onset - start) / NS_PER_S,
            "last": (self.last - start) / NS_PER_S,
            "seconds": (self.last - self.onset) / NS_PER_S,
            "contacts": len(self.runs),
            "contact_seconds": sum(lengths),
            "longest": max(lengths, default=0.0),
            "last_run": lengths[-1] if lengths else 0.0,
            "taxels": max(self.taxels, default=0),
            "taxels_median": float(np.median(self.taxels)) if self.taxels else 0,
            "area": 1e4 * self.area,
            "force": max(self.force, default=0.0),
            "sway": float(middle.std() / max(middle.mean(), 1e-9)) if self.force else 0,
            "peak": self.peak,
            "spread": self.spread,
            "breadth": 1e3 * float(np.median(self.breadth)) if self.breadth else 0.0,
            "since": self.since,
            "plausible": self.plausible,
            "merged": self.merged,
            "detections": [
                [one.gesture, one.confidence, (one.stamp - start) / NS_PER_S]
                for one in self.detections
            ],
            "chances": {name: round(one, 4) for name, one in self.chances.items()},
        }


@final
class SharedEvidence:
    """Shared evidence is that of the whole skin, which the stage updates."""

    def __init__(self, other: EvidenceMonitor) -> None:
        """Share the evidence of another one."""
        self.other = other

    def update(self, recognition: RecognitionState) -> None:
        """Do nothing."""

    def is_plausible(self, touch: int) -> bool:
        """Return whether a touch is no fault."""
        return self.other.is_plausible(touch)


@final
class Slot:
    """A slot is one event, with its arms and the touches that are nearest to it."""

    def __init__(
        self,
        event: Happening,
        world: str,
        info: SourceInfo,
        policies: dict[str, Callable[[SimulatedArm], Policy]],
        evidence: EvidenceMonitor,
        now: int,
    ) -> None:
        """Begin before the event, at a time [ns since the epoch]."""
        self.event, self.evidence, self.start = event, evidence, now
        self.touches: dict[int, TouchFeatures] = {}
        self.decisions: dict[str, list[CommandEvent]] = {name: [] for name in policies}
        self.policies: list[Policy] = []
        self.clock = ManualClock(now)
        self.normals = np.asarray(info.skin.normals)
        self.positions = np.asarray(info.skin.positions)
        self.areas = np.asarray(info.skin.areas)
        before = 0.0 if world == PAUSED_NOW else PAUSED_FOR
        self.clock.time = now - round(before * NS_PER_S)
        for name, build in policies.items():
            publish = self.decisions[name].append
            arm = SimulatedArm(clock=self.clock)
            if name == "paused":
                arm.pause()
            elif name == "slow":
                arm.set_speed(0.3)
            policy = build(arm)
            policy.start(Context(info, self.clock, publish))  # type: ignore[arg-type]
            policy.check_skin()
            policy.evidence = SharedEvidence(evidence)
            self.policies.append(policy)
        self.clock.time = now

    def push(self, recognition: RecognitionState) -> None:
        """Tell the policies and note the features of a reading."""
        stamp = recognition.state.reading.stamp
        self.clock.time = stamp
        for policy in self.policies:
            for detection in recognition.detections:
                policy.on_message(detection)
            policy.on_message(recognition)
        self.note(recognition, stamp)

    def note(self, recognition: RecognitionState, stamp: int) -> None:
        """Note the features of the touches of a reading."""
        state = recognition.state
        for row in state.rows:
            known = self.touches.get(row.id)
            if known is None:
                lasts = [one.last for one in self.touches.values()]
                known = self.touches[row.id] = TouchFeatures(row.onset, row.onset)
                if lasts:
                    known.since = (row.onset - max(lasts)) / NS_PER_S
            if row.closed and row.merged_into in self.touches:
                known.merged = True
                heir = self.touches[row.merged_into]
                heir.detections += known.detections
                heir.onset = min(heir.onset, known.onset)
            if row.last == stamp and not row.closed:
                self.note_contact(known, row, state)
        for detection in recognition.detections:
            if detection.touch in self.touches:
                self.touches[detection.touch].detections.append(detection)
        words = self.policies[0].vocabulary
        for number, chances in recognition.probabilities.items():
            if number in self.touches:
                known = self.touches[number]
                known.chances = dict(zip(words, map(float, chances), strict=True))
                known.plausible = self.evidence.is_plausible(number)

    def note_contact(
        self, known: TouchFeatures, row: TouchRecord, state: TouchState
    ) -> None:
        """Note the features of a touch in contact."""
        stamp = state.reading.stamp
        taxels, pressure = row.taxels, state.reading.pressure[row.taxels]
        if not known.runs or known.last != known.runs[-1][1] or self.gap(known, stamp):
            known.runs.append([stamp, stamp])
        known.runs[-1][1] = known.last = stamp
        known.taxels.append(len(taxels))
        known.force.append(float(row.force))
        known.area = max(known.area, float(self.areas[taxels].sum()))
        known.peak = max(known.peak, float(pressure.max(initial=0.0)))
        if len(taxels) > 1:
            normals = self.normals[taxels]
            least = float((normals @ normals.T).min())
            angle = float(np.degrees(np.arccos(np.clip(least, -1.0, 1.0))))
            known.spread = max(known.spread, angle)
            breadth = compute_breadth(self.positions[taxels], normals, pressure)
            known.breadth.append(breadth)

    def gap(self, known: TouchFeatures, stamp: int) -> bool:
        """Tell whether a touch was not in contact in the reading before."""
        return stamp - known.last > 1.6 * self.period

    period = 20_000_000
    """Time between readings [ns]."""

    def conclude(self, row: str, kind: str, seed: int) -> dict[str, Any]:
        """Return the line that is kept."""
        return {
            "row": row,
            "kind": kind,
            "seed": seed,
            "decided": {
                name: [(one.action, one.gesture, one.accepted, one.why) for one in some]
                for name, some in self.decisions.items()
            },
            "touches": [one.summarise(self.start) for one in self.touches.values()],
        }


def select_touches(recognition: RecognitionState, ids: set[int]) -> RecognitionState:
    """Return what is told of some touches alone."""
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
    """A stage is one build of a skin on a still robot, on which events take place."""

    def __init__(self, command: Command, kind: BuildKind, seed: int) -> None:
        """Build the skin; the first seed from the given one that is fast enough."""
        while True:
            self.skin = InteractiveSkin("ur5", seed, kind)
            if 1.0 / self.skin.period >= MIN_RATE:
                break
            seed += 1000
        self.kind, self.seed = kind, seed
        waypoints = FRAME_TASK.waypoints
        self.q = np.array(waypoints[seed % len(waypoints)].q, np.float64)
        self.skin.hand.q = self.q
        self.period = round(self.skin.period * NS_PER_S)
        self.now = NS_PER_S
        self.target = build_target(self.skin.mounted.skin, self.skin.calibration, seed)
        self.model = load_model(command.model)
        mounted = self.skin.mounted
        self.info = SourceInfo(
            uri="sim:events",
            robot_name=self.skin.wearer.name,
            joint_names=mounted.robot.joint_names,
            skin=mounted.skin,
            calibration=self.skin.calibration,
            rate=1.0 / self.skin.period,
        )
        words = self.model.card.vocabulary
        commands = load_commands(command.map, words, mounted.skin, simulated=True)
        config = PolicyConfig(check_period=None)
        self.policies = dict.fromkeys(
            ARMS, lambda arm: Policy(arm, commands, words, config)
        )

    def restart(self, row: str) -> None:
        """Start another recogniser for a row, and let it learn the baseline."""
        number = list(WORLDS).index(row)
        self.rng = np.random.default_rng([self.seed, 58, number])
        self.people = 1000 * self.seed + 20 * number
        self.drawn = 0
        mounted = self.skin.mounted
        self.recognizer = Recognizer(self.model, mounted, self.skin.calibration)
        self.evidence = EvidenceMonitor(mounted.skin, EvidenceConfig())
        for scan in self.scan([], round(WARM_UP / self.skin.period)):
            self.recognizer.push(scan)

    def draw_slots(self, row: str, count: int) -> list[Slot]:
        """Draw events that are far enough apart, at least one."""
        slots: list[Slot] = []
        for _ in range(4 * count):
            if len(slots) == count:
                break
            number = self.people + self.drawn // PERSON_EVENTS
            person = draw_demo_person(self.skin.env, number)
            event = WORLDS[row](EventDraw(self.skin, self.q, person, self.rng))
            places = [self.find_place(one.event) for one in slots]
            place = self.find_place(event)
            if all(np.linalg.norm(place - one) >= APART for one in places):
                self.drawn += 1
                slot = Slot(
                    event, row, self.info, self.policies, self.evidence, self.now
                )
                slot.period = self.period
                slots.append(slot)
        return slots

    def find_place(self, event: Happening) -> Float[np.ndarray, "3"]:
        """Return where an event takes place in the world [m]."""
        env, site = self.skin.env, event.site
        point = env.charts[site.chart].surface.wrap(np.array([site.centre]))
        T = env.poses(self.q)[env.links[site.chart]]
        return T[:3, :3] @ point.positions[0] + T[:3, 3]

    def find_owners(self, slots: list[Slot]) -> Int[np.ndarray, "taxel"]:
        """Return the nearest event of each taxel."""
        skin, robot = self.skin.mounted.skin, self.skin.mounted.robot
        poses = self.skin.env.poses(self.q)
        links = np.array([robot.link_index(p.link) for p in skin.patches])
        T = poses[links[np.asarray(skin.patch_index)]]
        world = np.einsum("tij,tj->ti", T[:, :3, :3], skin.positions) + T[:, :3, 3]
        places = np.stack([self.find_place(slot.event) for slot in slots])
        gaps = np.linalg.norm(world[:, None] - places[None], axis=2)
        return np.argmin(gaps, axis=1)

    def scan(self, slots: list[Slot], readings: int) -> Iterator[Scan]:
        """Simulate readings, in which events begin after the lead."""
        skin, mounted = self.skin, self.skin.mounted.skin
        step = skin.build.electronics.step
        lead = round(LEAD / step)
        touches = tuple(
            TrueTouch(
                "none",
                "",
                "",
                tuple(replace(p, first=p.first + lead) for p in slot.event.presses),
                {},
            )  # fmt: skip
            for slot in slots
        )
        scene = TouchScene(np.tile(self.q, (readings * skin.steps, 1)), touches)
        presses = compute_touch_presses(scene, skin.env)
        pressure, taxels = compute_scene_pressure(
            presses, scene.steps, skin.build.film_sigma, mounted
        )
        pulses = [self.build_pulses(slot.event) for slot in slots]
        done = 0
        while done < readings:
            some = min(readings - done, skin.sensor.noise.remaining)
            part = slice(done * skin.steps, (done + some) * skin.steps)
            before = skin.sensor.steps
            skin.sensor.push(pressure[part], taxels)
            places = before - 1.0 + skin.steps * np.arange(1, some + 1)
            for counts in skin.sensor.read(places):
                lost = skin.sensor.losses.draw_next()[0] & (done * step > LEAD)
                received = ~lost[mounted.patch_index]
                seconds = done * skin.period - LEAD
                added = sum(pulse(seconds) for pulse in pulses)
                counts = np.round(counts + added).astype(counts.dtype)
                counts = np.clip(counts, 0, self.target.full_scale)
                counts[~received] = 0
                self.now += self.period
                done += 1
                yield Scan(self.now, counts, received, self.q)

    def build_pulses(
        self, event: Happening
    ) -> Callable[[float], Float[np.ndarray, "taxel"] | float]:
        """Return what an event adds to the counts at a time after its start [s]."""
        pulses, skin = event.pulses, self.skin.mounted.skin
        if pulses is None:
            return lambda seconds: 0.0
        chart = self.skin.env.charts[event.site.chart]
        away = np.linalg.norm(chart.unrolled - event.site.centre, axis=1)
        near = chart.taxels[away <= max(pulses.reach, away.min())]
        first = chart.taxels[np.argmin(away)]
        if pulses.along_row:
            near = near[
                (skin.rows[near] == skin.rows[first])
                & (skin.patch_index[near] == skin.patch_index[first])
            ]
        size = np.zeros(skin.count)
        size[near] = self.rng.uniform(0.4, 1.0, len(near))
        size *= self.target.unit * 22.0

        def disturb(seconds: float) -> Float[np.ndarray, "taxel"]:
            level = max(
                [p for s, d, p in pulses.hits if s <= seconds < s + d], default=0.0
            )
            noise = self.rng.normal(1.0, pulses.noise, skin.count)
            return level * size * noise

        return disturb

    def play(self, slots: list[Slot]) -> None:
        """Let events take place at once."""
        owners, ids = self.find_owners(slots), [set() for _ in slots]
        ends = [
            max([p.first + p.steps for p in slot.event.presses], default=0) * 0.01
            for slot in slots
        ]
        for slot in slots:
            if slot.event.pulses:
                ends.append(max(s + d for s, d, _ in slot.event.pulses.hits))
        readings = round((LEAD + max(ends) + TAIL) / self.skin.period)
        for scan in self.scan(slots, readings):
            detections = tuple(self.recognizer.push(scan))
            state = self.recognizer.state
            assert state is not None
            recognition = RecognitionState(
                state, self.recognizer.probabilities, detections
            )
            self.evidence.update(recognition)
            for row in state.rows:
                taxels = row.taxels
                if len(taxels) and not any(row.id in some for some in ids):
                    ids[int(np.bincount(owners[taxels]).argmax())].add(row.id)
            for slot, own in zip(slots, ids, strict=True):
                slot.push(select_touches(recognition, own))

    def run_row(self, row: str, events: int) -> Iterator[dict[str, Any]]:
        """Yield what is kept of each event of a row."""
        self.restart(row)
        while events > 0:
            slots = self.draw_slots(row, min(SLOTS, events))
            self.play(slots)
            events -= len(slots)
            for slot in slots:
                yield slot.conclude(row, self.kind, self.seed)


MORE = ("resume", "jog", "next_waypoint", "previous_waypoint", "normal")
STOPS = ("pause", "hold", SUSPEND)


def count_told(lines: Lines) -> list[int]:
    """Count the events that started, sped up, moved on and stopped an arm.

    What the policy does by itself for the skin's sake counts only if it stops.
    """
    wanted = (
        ("paused", STARTING_ACTIONS),
        ("slow", MORE),
        ("working", MORE),
        ("working", STOPS),
    )
    return [
        sum(
            any(
                accepted and action in actions and (gesture or actions is STOPS)
                for action, gesture, accepted, _ in line["decided"][arm]
            )
            for line in lines
        )
        for arm, actions in wanted
    ]


def describe_detections(lines: Lines) -> str:
    """Return how often each gesture was detected, with its median confidence."""
    found: dict[str, list[float]] = {}
    for line in lines:
        for touch in line["touches"]:
            for gesture, confidence, _ in touch["detections"]:
                found.setdefault(gesture, []).append(confidence)
    order = sorted(found, key=lambda one: -len(found[one]))
    return ", ".join(f"{n} {len(found[n])} ({np.median(found[n]):.2f})" for n in order)


Rule = Callable[[dict[str, Any]], bool]


def require(gesture: str, least: float, said: float = 0.0, **limits: float) -> Rule:
    """Return a rule: a gesture, its probability at the end, and least features.

    `said` is the least confidence with which it was detected.
    """

    def rule(touch: dict[str, Any]) -> bool:
        detected = [c for name, c, _ in touch["detections"] if name == gesture]
        sure = touch["chances"].get(gesture, 0.0) >= least
        enough = all(touch[name] >= value for name, value in limits.items())
        usual = touch["plausible"] and touch["seconds"] >= 0.3 and not touch["merged"]
        return max(detected, default=-1.0) >= said and sure and enough and usual

    return rule


RULES: dict[str, Rule] = {
    "double_pat .88": require("double_pat", 0.88),
    "poke .88": require("poke", 0.88),
    "stroke .95": require("stroke", 0.95),
    "stroke .98": require("stroke", 0.98),
    "grab .90": require("grab", 0.9),
    "grab .95": require("grab", 0.95),
    "grab .98": require("grab", 0.98),
    "grab .95, 50 mm": require("grab", 0.95, breadth=50.0),
    "grab .90, 50 mm": require("grab", 0.9, breadth=50.0),
    "grab .80, 50 mm": require("grab", 0.8, breadth=50.0),
}
"""Candidates for what starts an arm, by their names; lengths are breadths [mm]."""


def print_rules(lines: Lines) -> None:
    """Print the share of events of each row in which a touch meets each rule."""
    print(format_head(["row", "events", *RULES]))
    for kind in dict.fromkeys(line["kind"] for line in lines):
        for row in WORLDS:
            own = [one for one in lines if one["row"] == row and one["kind"] == kind]
            if own:
                counts = [
                    sum(any(map(rule, one["touches"])) for one in own)
                    for rule in RULES.values()
                ]
                cells = [f"{kind}: {row}", str(len(own)), *map(str, counts)]
                print(format_row(cells))


def simulate_build(
    command: Command, kind: BuildKind, seed: int, done: Lines, file: TextIO | None
) -> Lines:
    """Return the lines of a build, those that are done included; keep the others."""
    stage, lines = None, []
    for row in WORLDS:
        if command.only and not any(part in row for part in command.only):
            continue
        own = [one for one in done if (one["row"], one["build"]) == (row, seed)]
        if not own:
            stage = stage or Stage(command, kind, seed)
            share = (command.events + seed - command.seed) // command.builds
            own = [one | {"build": seed} for one in stage.run_row(row, share)]
            # Rows are kept as a whole, so that none is taken for done before it is.
            if file:
                print("\n".join(map(json.dumps, own)), file=file, flush=True)
        lines += own
    return lines


def print_counts(kind: str, lines: Lines) -> None:
    """Print the table of a kind of builds."""
    total: Counter[str] = Counter()
    for row in WORLDS:
        own = [one for one in lines if one["row"] == row]
        if not own:
            continue
        counts = count_told(own)
        if row in THINGS:
            total.update(dict(zip(HEAD[2:], counts, strict=False)))
            total["events"] += len(own)
        cells = [f"{kind}: {row}", str(len(own)), *map(str, counts)]
        print(format_row([*cells, describe_detections(own)]))
    cells = [str(total[name]) for name in HEAD[1:6]]
    print(format_row([f"{kind}: all things", *cells, ""]), flush=True)


def read_lines(paths: Iterable[Path]) -> Lines:
    """Read what was kept in files; those that are missing hold nothing."""
    texts = [path.read_text("utf-8").splitlines() for path in paths if path.exists()]
    return [json.loads(line) for text in texts for line in text]


def main(command: Command) -> None:
    """Print how many events of each row command an arm, or meet rules."""
    if command.kept:
        return print_rules(read_lines(command.kept))
    done = read_lines([command.keep] if command.keep else [])
    print(format_head(HEAD))
    with command.keep.open("a") if command.keep else nullcontext() as file:
        for kind in command.kinds:
            own = [one for one in done if one["kind"] == kind]
            seeds = range(command.seed, command.seed + command.builds)
            print_counts(
                kind,
                [
                    line
                    for seed in seeds
                    for line in simulate_build(command, kind, seed, own, file)
                ],
            )
