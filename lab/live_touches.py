"""Measure recognition of touches by unseen people in the live simulation.

    python -m lab.live_touches --touches 200

Every sensor build is fresh and every person is new. They make one touch after the
other, on an arm that stands still and on one that swings; accidental contacts are mixed
in. Then the hand is guided from outside, as by a mouse. The command prints the recall
of each gesture, the gestures detected at accidental contacts, and the duration of a
scan.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import tyro
from jaxtyping import Float

from eskin.learn.events.event_scoring import EventScore, score_events
from eskin.learn.events.matching import ScoredStream, build_events
from eskin.live import Detection, Model, Recognizer, load_model
from eskin.recording import NONE, TruthRecord
from eskin.sim.interactive import InteractiveSkin, LinkPoint
from eskin.sim.people.gesture_sample import build_minimum_jerk
from eskin.sim.scene.motion import compute_max_speed
from eskin.sim.scene.poses import POSE_GROUPS, draw_pose
from eskin.touch import Scan
from eskin.units import NS_PER_S

GESTURES = ("poke", "double_pat", "grab", "stroke")
QUIET = 2.0
"""Time without touch at the start [s]."""

PAUSE = (1.5, 3.0)
"""Range of the time between two touches [s]."""

STRETCH = 0.3
"""Amplitude of the swing of the joints [rad]."""


Path = Callable[[float], Float[np.ndarray, "joint"]]


@dataclass(frozen=True)
class Command:
    """Simulate touches and score what is recognised."""

    touches: int = 200
    """Gestures in each part, equally many of each."""
    accidents: int = 100
    """Accidental contacts in each part."""
    skins: int = 10
    """Sensor builds, each with a person of its own, among which touches are divided."""
    kind: Literal["fresh", "shifted"] = "fresh"
    """Distributions that the builds are drawn from."""
    seed: int = 0
    """Seed of the first build; the others follow."""


@dataclass
class RunRecord:
    """Holds the touches of one skin and what was detected."""

    truths: list[TruthRecord] = field(default_factory=list)
    detections: list[Detection] = field(default_factory=list)
    scans: list[float] = field(default_factory=list)
    """Processor time of each scan [s]."""


class Run:
    """Runs one skin with a recogniser, and collects the results."""

    def __init__(
        self,
        live: InteractiveSkin,
        model: Model,
        path: Path,
        corrupt: Callable[[Scan], Scan] = lambda scan: scan,
    ) -> None:
        """Wait until the skin is tared; every scan is corrupted by a function."""
        self.live, self.path, self.corrupt = live, path, corrupt
        self.recognizer = Recognizer(model, live.mounted, live.calibration)
        self.time, self.record = 0.0, RunRecord()
        self.wait(QUIET)

    def scan(self) -> None:
        """Simulate and recognise one reading."""
        self.time += self.live.period
        q = self.path(self.time)
        begun = time.thread_time()
        scan = self.corrupt(self.live.scan(round(self.time * NS_PER_S), q))
        self.record.scans.append(time.thread_time() - begun)
        self.record.truths += self.live.hand.truths()
        self.record.detections += self.recognizer.push(scan)

    def wait(self, seconds: float) -> None:
        """Simulate a span of time [s]."""
        for _ in range(round(seconds / self.live.period)):
            self.scan()

    def finish(self) -> None:
        """Simulate until the last touch is over."""
        while self.live.hand.touching:
            self.scan()

    def take(self) -> ScoredStream:
        """Return the results for scoring."""
        self.record.detections += self.recognizer.finish()
        events = sorted(build_events(self.record.truths), key=lambda e: e.onset)
        person = self.live.hand.person.name
        return ScoredStream(tuple(events), self.record.detections, self.time, person)


def stand_still(q: Float[np.ndarray, "joint"], live: InteractiveSkin) -> Path:
    """Return the motion of an arm that stands still."""
    return lambda seconds: q


def swing(q: Float[np.ndarray, "joint"], live: InteractiveSkin) -> Path:
    """Return the motion of an arm that swings, as fast as allowed near people."""
    direction = np.where(np.arange(len(q)) % 2, 1.0, -1.0)
    speed = min(0.8, compute_max_speed(live.env, q[None], direction))
    return lambda seconds: q + STRETCH * direction * np.sin(seconds * speed / STRETCH)


def perform_touches(run: Run, command: Command, rng: np.random.Generator) -> None:
    """Perform scripted touches of the person, with accidental contacts between them."""
    many = command.touches // command.skins
    wanted = [GESTURES[i % len(GESTURES)] for i in range(many)]
    wanted += [NONE] * (command.accidents // command.skins)
    for what in rng.permutation(wanted):
        run.live.hand.perform(str(what))
        run.finish()
        run.wait(rng.uniform(*PAUSE))


def guide_hand(run: Run, command: Command, rng: np.random.Generator) -> None:
    """Touch as by a mouse: pokes, double pats, grabs of a given force, and drags."""
    for number in range(command.touches // command.skins):
        what = GESTURES[number % len(GESTURES)]
        hand, place = run.live.hand, draw_place(run, rng)
        if what == "poke":
            hand.poke(place, 5.0, 0.3)
        elif what == "double_pat":
            hand.double_pat(place, 6.0)
        elif what == "grab":
            hand.grab(place, 35.0, 0.9)
        else:
            drag(run, place, rng)
        run.finish()
        run.wait(rng.uniform(*PAUSE))


def draw_place(run: Run, rng: np.random.Generator) -> LinkPoint:
    """Draw a place in the middle of one of the long patches."""
    skin = run.live.mounted.skin
    patch = str(rng.choice(["forearm_front", "forearm_back", "upper_arm_back"]))
    taxels = skin.find_taxels(patch)
    inner = taxels[(skin.columns[taxels] > 3) & (skin.columns[taxels] < 12)]
    taxel = rng.choice(inner[len(inner) // 4 : -len(inner) // 4])
    link = skin.patches[skin.patch_index[taxel]].link
    return LinkPoint(link, skin.positions[taxel].astype(np.float64))


def drag(run: Run, place: LinkPoint, rng: np.random.Generator) -> None:
    """Drag a finger along the link."""
    length, speed = rng.uniform(0.1, 0.18), rng.uniform(0.1, 0.3)
    chart = next(c for c in run.live.env.charts if c.link == place.link)
    way = rng.choice([-1.0, 1.0]) * length * chart.surface.T_link_surface[:3, 2]
    touch = run.live.hand.begin(LinkPoint(place.link, place.p_link - way / 2), 3.0)
    for share in build_minimum_jerk(round(length / speed / run.live.period)):
        here = place.p_link + (share - 0.5) * way
        run.live.hand.move(touch, LinkPoint(place.link, here))
        run.scan()
    run.live.hand.end(touch)


PARTS = (
    ("scripted, still", perform_touches, stand_still),
    ("scripted, moving", perform_touches, swing),
    ("guided, still", guide_hand, stand_still),
    ("guided, moving", guide_hand, swing),
)


def main() -> None:
    """Print the results of each part."""
    command = tyro.cli(Command)
    model = load_model("ur5")
    for name, touch, way in PARTS:
        runs = [*run_skins(command, model, touch, way)]
        takes = [run.take() for run in runs]
        score = score_events(takes, model.card.vocabulary)
        scans = 1e3 * np.concatenate([run.record.scans for run in runs])
        print(f"\n{name}: {len(scans)} scans of {np.median(scans):.2f} ms", end=", ")
        print(f"99 % within {np.percentile(scans, 99):.2f} ms of a core")
        print_score(score)


def run_skins(
    command: Command,
    model: Model,
    touch: Callable[[Run, Command, np.random.Generator], None],
    way: Callable[[Float[np.ndarray, "joint"], InteractiveSkin], Path],
) -> Iterator[Run]:
    """Yield the run of every skin after its touches."""
    for number in range(command.skins):
        rng = np.random.default_rng((command.seed, number))
        live = InteractiveSkin("ur5", command.seed + number, command.kind)
        q = draw_pose(live.env, POSE_GROUPS, rng)
        run = Run(live, model, way(q, live))
        touch(run, command, rng)
        yield run


def print_score(score: EventScore) -> None:
    """Print scores and confusions."""
    for gesture, tally in score.per_gesture.items():
        made = tally.matched + tally.missed
        detected = f"{tally.matched} of {made}"
        print(f"{gesture:11} {detected}, {tally.false} false detections")
    low, high = score.f1_interval
    total = score.total
    print(f"F1 {total.f1:.3f} ({low:.3f}-{high:.3f})", end=", ")
    print(f"recall {total.recall:.3f}, precision {total.precision:.3f}")
    accidents = score.accidents
    print(
        "accidental contacts detected as gestures: "
        f"{accidents.mistaken} of {accidents.count}"
    )
    print("true\\detected" + " ".join(f"{name:>10}" for name in score.names))
    for name, row in zip(score.names, score.confusion, strict=True):
        print(f"{name:11} " + " ".join(f"{count:10}" for count in row))


if __name__ == "__main__":
    main()
