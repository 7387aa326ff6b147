"""The same counts in two poses."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from typing import Literal, final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.command.command_map import NON_GESTURES
from eskin.demo.headless import DemoConfig
from eskin.live import Detection, Recognizer
from eskin.model import Model, load_model
from eskin.page.scene import CAMERA
from eskin.sim.dataset.clip import build_of
from eskin.sim.dataset.pairs import pair_of, world_of
from eskin.sim.dataset.plan import ClipPlan
from eskin.sim.dataset.session_plan import plan_alone, seed_of
from eskin.sim.scene.environment import World
from eskin.sim.scene.validity import is_free, limits
from eskin.skin import SKIN_PRESETS, MountedSkin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S

REST, AFTER = 4.0, 4.0
"""Without touch before and after the counts that are compared [s]."""
GOING = 3.0
"""Of the rest, what the arm takes to come to its pose [s]."""
LINE = 60
"""Poses on a way that are looked at."""
TRIES = 400
"""Pairs drawn at most for one to which there is a free way."""
FEW = 5
"""Most loaded taxels of a link that are looked at."""
TURNS = 73
"""Turns of the base that are tried."""
SEEDS = 1_000_000
"""Of pairs, from one seed to the next."""

Pose = Float[np.ndarray, "joint"]


@dataclass(frozen=True, eq=False)
class SameTouch:
    """What is played twice, and the poses that it is played in."""

    counts: Int[np.ndarray, "reading taxel"]
    """What the converter counted."""

    received: Bool[np.ndarray, "reading taxel"]
    """False where no fresh data came."""

    poses: tuple[Pose, Pose]
    """Of the gesture, and of what is none [rad]."""

    labels: tuple[str, str]
    """What is truly done in either."""

    mounted: MountedSkin
    """The skin on its robot."""

    calibration: Calibration
    """Of the build that was touched."""

    period: int
    """Between two readings [ns]."""

    @property
    def seconds(self) -> float:
        """Of one playing [s]."""
        return len(self.counts) * self.period / NS_PER_S

    def scans(self, side: int, begin: int, come_from: Pose | None) -> Iterator[Scan]:
        """One playing.

        Args:
            side: of the pose, 0 or 1.
            begin: stamp of its first scan [ns since the epoch].
            come_from: where the arm is before [rad]; None where it is there already.
        """
        pose = self.poses[side]
        start = pose if come_from is None else come_from
        for index, (counts, received) in enumerate(
            zip(self.counts, self.received, strict=True)
        ):
            way = min(index * self.period / (GOING * NS_PER_S), 1.0)
            q = pose + (start - pose) * (1 + np.cos(np.pi * way)) / 2
            yield Scan(begin + index * self.period, counts, received, q)


def draw_touches(
    number: int,
    skin: str = "ur5",
    build_kind: Literal["fresh", "shifted"] = "fresh",
    seed: int = 0,
) -> tuple[SameTouch, ...]:
    """Touches of several people on one build of the sensor; no set has any of them.

    The arm can go straight from each pose to the next, and from the last to the first.

    Args:
        number: how many.
        skin: a preset.
        build_kind: which laws the sensor is drawn from.
        seed: decides all that is drawn.

    Raises:
        ValueError: there is no such skin, its patches never meet, the seed is
            negative, or too few ways are free.
    """
    if skin not in SKIN_PRESETS or seed < 0:
        raise ValueError(
            f"skin '{skin}' with seed {seed}; allowed are {', '.join(SKIN_PRESETS)} and "
            "seeds of 0 and above; change it"
        )
    world = world_of(skin)
    level, own = world.constants.value("sets.difficulty"), seed * SEEDS
    first = plan_alone("merging", own, level, world.constants)
    build = replace(first.build, kind=build_kind)
    found: list[SameTouch] = []
    for trial in count():
        if trial == TRIES * number:
            raise ValueError(
                f"{len(found)} pairs of poses with free ways between them were found; "
                f"wanted are {number}; ask for fewer, or give another --seed"
            )
        plan = plan_alone("merging", own + trial, level, world.constants)
        plan = replace(plan, build=build, session=first.session)
        touch = touch_of(plan, world)
        before = [found[-1].poses[1]] if found else []
        last = [found[0].poses[0]] if found and len(found) == number - 1 else []
        if is_way_free([*before, *touch.poses, *last], world):
            found.append(touch)
        if len(found) == number:
            return tuple(found)
    raise AssertionError


def touch_of(plan: ClipPlan, world: World) -> SameTouch:
    """The counts of a plan of the first side of a pair, with rest around them."""
    assert plan.pair is not None
    idle = replace(
        plan,
        seed=seed_of("same touch rest", 0, 0, plan.seed[-1]),
        kind="idle",
        gesture="none",
        seconds=REST + AFTER,
        pair=replace(plan.pair, number=-1, gesture="none"),
    )
    pair, rest = pair_of(plan, world), pair_of(idle, world).first
    period = round(world.constants.value("sensor.period") * NS_PER_S)
    cut = round(REST * NS_PER_S / period)
    touched = pair.first
    pressed = heaviest(touched.counts, world.mounted)
    return SameTouch(
        counts=np.concatenate([rest.counts[:cut], touched.counts, rest.counts[cut:]]),
        received=np.concatenate(
            [rest.received[:cut], touched.received, rest.received[cut:]]
        ),
        poses=(
            turned(touched.q[0], pressed, world),
            turned(pair.second.q[0], pressed, world),
        ),
        labels=pair.labels,
        mounted=world.mounted,
        calibration=build_of(plan.build, world).calibration(world.mounted.skin),
        period=period,
    )


def heaviest(
    counts: Int[np.ndarray, "reading taxel"], mounted: MountedSkin
) -> list[Int[np.ndarray, "few"]]:
    """The most loaded taxels of each link that is touched."""
    rise = counts.max(axis=0) - np.median(counts, axis=0)
    links = np.asarray(mounted.taxel_link_index)
    every = [np.flatnonzero(links == link) for link in np.unique(links)]
    return [
        taxels[np.argsort(rise[taxels])[-FEW:]]
        for taxels in every
        if rise[taxels].max() > rise.max() / 3
    ]


def turned(pose: Pose, pressed: list[Int[np.ndarray, "few"]], world: World) -> Pose:
    """A pose with the base turned so that the page shows all that is pressed.

    That turns the arm as a whole, and changes nothing on it.
    """
    low, high = (float(each[0]) for each in limits(world))
    poses = np.tile(pose, (TURNS, 1))
    poses[:, 0] = np.linspace(low, high, TURNS)
    seen = [
        [float((world.mounted.place_taxels(q, taxels)[1] @ CAMERA).mean()) for q in poses]
        for taxels in pressed
    ]
    return poses[int(np.min(seen, axis=0).argmax())]


def is_way_free(poses: list[Pose], world: World) -> bool:
    """Whether the arm meets neither itself nor the table from each pose to the next."""
    lines = [np.linspace(a, b, LINE) for a, b in zip(poses, poses[1:], strict=False)]
    return bool(is_free(world, world.poses(np.concatenate(lines))).all())


BLIND = "ur5-blind"


@dataclass(frozen=True, eq=False)
class RecognitionResult:
    """What is said of one playing."""

    said: tuple[tuple[str, float], ...]
    """Gesture and confidence of each touch, in the order in which they were said."""

    probabilities: Float[np.ndarray, "class"]
    """Of the strongest touch, as it was spoken of: at once, or after it closed by what
    its latest contact told; zeros before there is one."""

    @property
    def words(self) -> tuple[str, ...]:
        """What is said, in words."""
        return tuple(
            f"{gesture.replace('_', ' ')} {sure:.0%}" for gesture, sure in self.said
        )

    @property
    def gestures(self) -> list[str]:
        """What was recognised, less what is no gesture."""
        return [gesture for gesture, _ in self.said if gesture not in NON_GESTURES]

    def is_right(self, label: str) -> bool:
        """Whether it says what is truly done, once, and nothing else."""
        return self.gestures == ([] if label in NON_GESTURES else [label])


@final
class RecognitionRun:
    """A recogniser that has heard nothing before, listening to one playing."""

    def __init__(self, model: Model, touch: SameTouch) -> None:
        """Listen with a model."""
        self.recognizer = Recognizer(model, touch.mounted, touch.calibration)
        self.classes = len(model.card.vocabulary)
        self.chances: dict[int, np.ndarray] = {}
        self.spoken: set[int] = set()
        self.detections: list[Detection] = []

    def on_message(self, scan: Scan) -> None:
        """Take in the next scan."""
        said = self.recognizer.push(scan)
        self.detections += said
        state = self.recognizer.state
        assert state is not None
        heard = {touch.id for touch in state.open}
        heard |= {detection.touch for detection in said}
        self.chances |= {
            touch: chances
            for touch, chances in self.recognizer.probabilities.items()
            if touch in heard - self.spoken
        }
        self.spoken |= {detection.touch for detection in said}

    def finish(self) -> None:
        """Take in the end."""
        self.detections += self.recognizer.finish()

    @property
    def answer(self) -> RecognitionResult:
        """What it says so far."""
        touch = max(self.chances, default=None)
        if self.detections:
            touch = max(self.detections, key=lambda each: each.peak_force).touch
        chances = np.zeros(self.classes) if touch is None else self.chances[touch]
        said = tuple((each.gesture, each.confidence) for each in self.detections)
        return RecognitionResult(said, chances)


def recognise_touch(touch: SameTouch, side: int, model: Model) -> RecognitionResult:
    """What is said of the playing in one of its poses."""
    opinion = RecognitionRun(model, touch)
    for scan in touch.scans(side, touch.period, None):
        opinion.on_message(scan)
    opinion.finish()
    return opinion.answer


@dataclass(frozen=True, eq=False)
class PoseComparison:
    """What two recognisers say of one touch in both of its poses."""

    labels: tuple[str, str]
    """What is truly done in either."""

    posed: tuple[RecognitionResult, RecognitionResult]
    """Of the one that sees the pose."""

    blind: tuple[RecognitionResult, RecognitionResult]
    """Of the one that does not."""

    def right(self, answers: tuple[RecognitionResult, RecognitionResult]) -> int:
        """In how many of the poses that is what is truly done."""
        return sum(map(RecognitionResult.is_right, answers, self.labels))

    @property
    def is_blind(self) -> bool:
        """Whether the one that sees no pose says the same twice, to the last digit."""
        one, other = self.blind
        alike = np.array_equal(one.probabilities, other.probabilities)
        return one.said == other.said and alike


def compare(number: int, config: DemoConfig) -> list[PoseComparison]:
    """What both say of some touches, as fast as the computer can.

    Args:
        number: of touches.
        config: what is demonstrated.
    """
    models = load_both_models(config.model)
    touches = draw_touches(number, config.skin, config.build_kind, config.seed)
    found = []
    for touch in touches:
        posed, blind = (
            (recognise_touch(touch, 0, model), recognise_touch(touch, 1, model))
            for model in models
        )
        found.append(PoseComparison(touch.labels, posed, blind))
    return found


def load_both_models(name: str) -> tuple[Model, Model]:
    """A model, and one that was trained without ever seeing the pose."""
    return load_model(name), load_model(BLIND)
