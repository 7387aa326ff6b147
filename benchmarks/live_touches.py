"""Touches of unseen people in the live simulated world: how many are recognised.

    python -m benchmarks.live_touches --touches 200

Every sensor build is fresh and every person new. They do one thing after the other, on
an arm that stands still and on one that goes to and fro; accidental contacts come
between. Then the hand is led from outside, as by a mouse. Prints recall by gesture,
what accidents were taken for, and how long a scan takes.
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
from eskin.live import Detection, Recognizer
from eskin.model import Model, load_model
from eskin.recording import NONE, TruthRecord
from eskin.sim.interactive import InteractiveSkin, LinkPoint
from eskin.sim.people.gesture_sample import build_minimum_jerk
from eskin.sim.scene.motion import compute_max_speed
from eskin.sim.scene.poses import POSE_GROUPS, draw_pose
from eskin.units import NS_PER_S

GESTURES = ("poke", "double_pat", "grab", "stroke")
QUIET = 2.0
"""Without touch at first [s]."""

PAUSE = (1.5, 3.0)
"""Between two touches [s]."""

STRETCH = 0.3
"""How far joints go to either side [rad]."""


Path = Callable[[float], Float[np.ndarray, "joint"]]


@dataclass(frozen=True)
class Command:
    """Touch, and count what is recognised."""

    touches: int = 200
    """Gestures in each part, all alike often."""

    accidents: int = 100
    """Accidental contacts in each part."""

    skins: int = 10
    """Builds, each with a person of its own, that share them."""

    kind: Literal["fresh", "shifted"] = "fresh"
    """Laws of the builds."""

    seed: int = 0
    """Of the first build; the others follow."""


@dataclass
class Message:
    """What happened to one skin."""

    truths: list[TruthRecord] = field(default_factory=list)
    detections: list[Detection] = field(default_factory=list)
    scans: list[float] = field(default_factory=list)
    """How long each scan took on its core [s]."""


class Run:
    """One skin with a recogniser, and what it has heard."""

    def __init__(self, live: InteractiveSkin, model: Model, path: Path) -> None:
        """Wait until a baseline is found."""
        self.live, self.path = live, path
        self.recognizer = Recognizer(model, live.mounted, live.calibration)
        self.time, self.heard = 0.0, Message()
        self.wait(QUIET)

    def scan(self) -> None:
        """Let one reading pass."""
        self.time += self.live.period
        q = self.path(self.time)
        begun = time.thread_time()
        scan = self.live.scan(round(self.time * NS_PER_S), q)
        self.heard.scans.append(time.thread_time() - begun)
        self.heard.truths += self.live.hand.truths()
        self.heard.detections += self.recognizer.push(scan)

    def wait(self, seconds: float) -> None:
        """Let time pass."""
        for _ in range(round(seconds / self.live.period)):
            self.scan()

    def finish(self) -> None:
        """Wait until the last touch is over."""
        while self.live.hand.touching:
            self.scan()

    def take(self) -> ScoredStream:
        """To be scored."""
        self.heard.detections += self.recognizer.finish()
        events = sorted(build_events(self.heard.truths), key=lambda e: e.onset)
        person = self.live.hand.person.name
        return ScoredStream(tuple(events), self.heard.detections, self.time, person)


def still(q: Float[np.ndarray, "joint"], live: InteractiveSkin) -> Path:
    """An arm that stands."""
    return lambda seconds: q


def to_and_fro(q: Float[np.ndarray, "joint"], live: InteractiveSkin) -> Path:
    """An arm whose joints swing together, as fast as arms among people may."""
    direction = np.where(np.arange(len(q)) % 2, 1.0, -1.0)
    speed = min(0.8, compute_max_speed(live.env, q[None], direction))
    return lambda seconds: q + STRETCH * direction * np.sin(seconds * speed / STRETCH)


def acted(run: Run, command: Command, rng: np.random.Generator) -> None:
    """Scripted touches by the person, and accidents between."""
    many = command.touches // command.skins
    wanted = [GESTURES[i % len(GESTURES)] for i in range(many)]
    wanted += [NONE] * (command.accidents // command.skins)
    for what in rng.permutation(wanted):
        run.live.hand.perform(str(what))
        run.finish()
        run.wait(rng.uniform(*PAUSE))


def led(run: Run, command: Command, rng: np.random.Generator) -> None:
    """What a mouse does: pokes, pats and grabs of a given force, fingers dragged."""
    for number in range(command.touches // command.skins):
        what = GESTURES[number % len(GESTURES)]
        hand, place = run.live.hand, pointed_at(run, rng)
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


def pointed_at(run: Run, rng: np.random.Generator) -> LinkPoint:
    """A place amid one of the long patches."""
    skin = run.live.mounted.skin
    patch = str(rng.choice(["forearm_front", "forearm_back", "upper_arm_back"]))
    taxels = skin.find_taxels(patch)
    inner = taxels[(skin.columns[taxels] > 3) & (skin.columns[taxels] < 12)]
    taxel = rng.choice(inner[len(inner) // 4 : -len(inner) // 4])
    link = skin.patches[skin.patch_index[taxel]].link
    return LinkPoint(link, skin.positions[taxel].astype(np.float64))


def drag(run: Run, place: LinkPoint, rng: np.random.Generator) -> None:
    """Fingers that follow a pointer along the link."""
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
    ("scripted, still", acted, still),
    ("scripted, moving", acted, to_and_fro),
    ("led, still", led, still),
    ("led, moving", led, to_and_fro),
)


def main() -> None:
    """Print a table for each part."""
    command = tyro.cli(Command)
    model = load_model("ur5")
    for name, touch, way in PARTS:
        runs = [*touched(command, model, touch, way)]
        takes = [run.take() for run in runs]
        score = score_events(takes, model.card.vocabulary)
        scans = 1e3 * np.concatenate([run.heard.scans for run in runs])
        print(f"\n{name}: {len(scans)} scans of {np.median(scans):.2f} ms", end=", ")
        print(f"99 % within {np.percentile(scans, 99):.2f} ms of a core")
        report(score)


def touched(
    command: Command,
    model: Model,
    touch: Callable[[Run, Command, np.random.Generator], None],
    way: Callable[[Float[np.ndarray, "joint"], InteractiveSkin], Path],
) -> Iterator[Run]:
    """Every skin, after all that was done to it."""
    for number in range(command.skins):
        rng = np.random.default_rng((command.seed, number))
        live = InteractiveSkin("ur5", command.seed + number, command.kind)
        q = draw_pose(live.env, POSE_GROUPS, rng)
        run = Run(live, model, way(q, live))
        touch(run, command, rng)
        yield run


def report(score: EventScore) -> None:
    """Print what was recognised and what was not."""
    for gesture, tally in score.per_gesture.items():
        made = tally.matched + tally.missed
        print(f"{gesture:11} {tally.matched} of {made}, {tally.false} said falsely")
    low, high = score.f1_interval
    total = score.total
    print(f"F1 {total.f1:.3f} ({low:.3f}-{high:.3f})", end=", ")
    print(f"recall {total.recall:.3f}, precision {total.precision:.3f}")
    accidents = score.accidents
    print(f"accidents taken for a gesture: {accidents.mistaken} of {accidents.count}")
    print("true\\said   " + " ".join(f"{name:>10}" for name in score.names))
    for name, row in zip(score.names, score.confusion, strict=True):
        print(f"{name:11} " + " ".join(f"{count:10}" for count in row))


if __name__ == "__main__":
    main()
