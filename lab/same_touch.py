"""Play the same counts on the skin in two poses of the arm, to two recognisers.

    python -m lab.same_touch --pairs 6

In the two poses the counts mean different gestures. The answers of a recogniser that
uses the pose stand beside those of one that does not.
"""

import sys
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.command import NON_GESTURES
from eskin.errors import DeviceError
from eskin.live import Detection, Model, Recognizer, load_model
from eskin.page.messages import CAMERA_DIRECTION
from eskin.sim.dataset import (
    ClipPlan,
    build_seed,
    get_build,
    plan_single_pair,
    simulate_pair,
)
from eskin.sim.scene import (
    SimEnvironment,
    are_collision_free,
    compute_joint_limits,
    load_environment,
)
from eskin.skin import MountedSkin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S, format_count
from lab.program import run_program

REST_BEFORE = 4.0
REST_AFTER = 4.0
"""Time without touch before and after the counts that are compared [s]."""
PATH_SAMPLES = 60
"""Number of poses on a path that are checked for collisions."""
MAX_DRAWS = 400
"""Greatest number of pairs drawn per pair with collision-free paths."""
TOP_TAXELS = 5
"""Number of the most loaded taxels of a link that are kept in view."""
BASE_ANGLES = 73
"""Number of base angles that are tried."""
SEED_STRIDE = 1_000_000
"""Offset between the seeds of pairs of successive `seed`s."""

Pose = Float[np.ndarray, "joint"]


@dataclass(frozen=True, eq=False)
class SameTouch:
    """Holds counts that are played twice, and the two poses for them."""

    counts: Int[np.ndarray, "reading taxel"]
    """Counts of the converter."""
    received: Bool[np.ndarray, "reading taxel"]
    """Whether a taxel was received."""
    poses: tuple[Pose, Pose]
    """Joint positions of the gesture, and of no gesture [rad]."""
    labels: tuple[str, str]
    """True label in each pose."""
    mounted: MountedSkin
    """The skin on its robot."""
    calibration: Calibration
    """Calibration of the build that was touched."""
    period: int
    """Time between two readings [ns]."""

    def scans(self, side: int) -> Iterator[Scan]:
        """Yield the scans of one playback, in the pose of an index, 0 or 1."""
        rows = zip(self.counts, self.received, strict=True)
        for number, (counts, received) in enumerate(rows, 1):
            yield Scan(number * self.period, counts, received, self.poses[side])


def draw_touches(number: int, seed: int = 0) -> tuple[SameTouch, ...]:
    """Draw touches of people of no data set, on one fresh build of the ur5 skin.

    The arm can go straight from each pose to the next, and from the last to the first.

    Args:
        number: number of touches.
        seed: seed of all that is drawn, 0 and above.

    Raises:
        ValueError: too few paths are collision-free.
    """
    environment = load_environment("ur5")
    level = environment.constants.value("sets.difficulty")
    own = seed * SEED_STRIDE
    first = plan_single_pair("merging", own, level, environment.constants)
    build = replace(first.build, kind="fresh")
    found: list[SameTouch] = []
    for trial in count():
        if trial == MAX_DRAWS * number:
            raise ValueError(
                f"{len(found)} pairs of poses with free paths between them found; "
                f"wanted are {number}; give fewer --pairs, or another --seed"
            )
        plan = plan_single_pair("merging", own + trial, level, environment.constants)
        plan = replace(plan, build=build, session=first.session)
        touch = build_touch(plan, environment)
        before = [found[-1].poses[1]] if found else []
        last = [found[0].poses[0]] if found and len(found) == number - 1 else []
        if is_path_free([*before, *touch.poses, *last], environment):
            found.append(touch)
        if len(found) == number:
            return tuple(found)
    raise AssertionError


def build_touch(plan: ClipPlan, environment: SimEnvironment) -> SameTouch:
    """Build the counts of the first side of a planned pair, with rest around them."""
    assert plan.pair is not None
    idle = replace(
        plan,
        seed=build_seed("same touch rest", 0, 0, plan.seed[-1]),
        kind="idle",
        gesture="none",
        seconds=REST_BEFORE + REST_AFTER,
        pair=replace(plan.pair, number=-1, gesture="none"),
    )
    pair = simulate_pair(plan, environment)
    rest = simulate_pair(idle, environment).first
    period = round(environment.constants.value("sensor.period") * NS_PER_S)
    cut = round(REST_BEFORE * NS_PER_S / period)
    touched = pair.first
    pressed = find_most_loaded(touched.counts, environment.mounted)
    return SameTouch(
        counts=np.concatenate([rest.counts[:cut], touched.counts, rest.counts[cut:]]),
        received=np.concatenate(
            [rest.received[:cut], touched.received, rest.received[cut:]]
        ),
        poses=(
            turn_to_camera(touched.q[0], pressed, environment),
            turn_to_camera(pair.second.q[0], pressed, environment),
        ),
        labels=pair.labels,
        mounted=environment.mounted,
        calibration=get_build(plan.build, environment).calibration(
            environment.mounted.skin
        ),
        period=period,
    )


def find_most_loaded(
    counts: Int[np.ndarray, "reading taxel"], mounted: MountedSkin
) -> list[Int[np.ndarray, "few"]]:
    """Return the most loaded taxels of each link that is touched."""
    rise = counts.max(axis=0) - np.median(counts, axis=0)
    links = np.asarray(mounted.taxel_link_index)
    every = [np.flatnonzero(links == link) for link in np.unique(links)]
    return [
        taxels[np.argsort(rise[taxels])[-TOP_TAXELS:]]
        for taxels in every
        if rise[taxels].max() > rise.max() / 3
    ]


def turn_to_camera(
    pose: Pose, pressed: list[Int[np.ndarray, "few"]], environment: SimEnvironment
) -> Pose:
    """Turn the base joint of a pose so that the page shows the pressed taxels.

    The arm turns as a whole, so its shape does not change.
    """
    place = environment.mounted.place_taxels
    low, high = (float(each[0]) for each in compute_joint_limits(environment))
    poses = np.tile(pose, (BASE_ANGLES, 1))
    poses[:, 0] = np.linspace(low, high, BASE_ANGLES)
    seen = [
        [float((place(q, taxels)[1] @ CAMERA_DIRECTION).mean()) for q in poses]
        for taxels in pressed
    ]
    return poses[int(np.min(seen, axis=0).argmax())]


def is_path_free(poses: list[Pose], environment: SimEnvironment) -> bool:
    """Return whether the arm meets neither itself nor the table between the poses."""
    lines = [
        np.linspace(a, b, PATH_SAMPLES) for a, b in zip(poses, poses[1:], strict=False)
    ]
    return bool(
        are_collision_free(environment, environment.poses(np.concatenate(lines))).all()
    )


BLIND_MODEL = "ur5-blind"
"""Name of weights that were trained without the pose."""


@dataclass(frozen=True, eq=False)
class RecognitionResult:
    """Holds what was recognised in one playback."""

    detected: tuple[tuple[str, float], ...]
    """Gesture and confidence of each detection, in their order."""
    probabilities: Float[np.ndarray, "class"]
    """Probabilities of the strongest touch, at its detection or, by the closing layer,
    as it closes; zeros before there is a touch."""

    @property
    def texts(self) -> tuple[str, ...]:
        """The detections as texts for people."""
        return tuple(
            f"{gesture.replace('_', ' ')} {confidence:.0%}"
            for gesture, confidence in self.detected
        )

    @property
    def gestures(self) -> list[str]:
        """The recognised gestures, without classes that are not gestures."""
        return [gesture for gesture, _ in self.detected if gesture not in NON_GESTURES]

    def is_correct(self, label: str) -> bool:
        """Return whether exactly the true label was recognised, and only once."""
        return self.gestures == ([] if label in NON_GESTURES else [label])


def recognise_touch(touch: SameTouch, side: int, model: Model) -> RecognitionResult:
    """Recognise the playback of a touch in one of its poses."""
    recognizer = Recognizer(model, touch.mounted, touch.calibration)
    classifier = recognizer.classifier
    found: list[Detection] = []
    last: dict[int, np.ndarray] = {}
    for scan in touch.scans(side):
        new = recognizer.push(scan)
        assert recognizer.state is not None
        is_open = {each.id for each in recognizer.state.open}
        detected = {each.touch for each in found}
        for key in is_open - detected:
            last[key] = classifier.closing_probabilities[classifier.get_key(key)]
        for each in new:
            # One that is reported while it is open is reported by the open layer.
            if each.touch in is_open:
                last[each.touch] = recognizer.probabilities[each.touch]
        found += new
    found += recognizer.finish()
    strongest = max(last, default=None)
    if found:
        strongest = max(found, key=lambda each: each.peak_force).touch
    nothing = np.zeros(len(model.card.vocabulary))
    probabilities = nothing if strongest is None else last[strongest]
    pairs = tuple((each.gesture, each.confidence) for each in found)
    return RecognitionResult(pairs, probabilities)


@dataclass(frozen=True, eq=False)
class PoseComparison:
    """Holds the results of two models in both poses of a touch."""

    labels: tuple[str, str]
    """True label in each pose."""
    posed: tuple[RecognitionResult, RecognitionResult]
    """Results of the recogniser that sees the pose."""
    blind: tuple[RecognitionResult, RecognitionResult]
    """Results of the recogniser that does not see the pose."""

    def count_correct(
        self, results: tuple[RecognitionResult, RecognitionResult]
    ) -> int:
        """Return the number of poses in which the results are correct."""
        return sum(map(RecognitionResult.is_correct, results, self.labels))

    @property
    def blind_is_equal(self) -> bool:
        """Return whether both results without the pose are equal to the last digit."""
        one, other = self.blind
        equal = np.array_equal(one.probabilities, other.probabilities)
        return one.detected == other.detected and equal


@dataclass(frozen=True)
class Command:
    """Compare two recognisers on the same touches."""

    seed: int = 0
    """Seed of the touches."""

    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""

    pairs: int = 6
    """Number of touches that are played in turn."""


def main(command: Command) -> dict[str, object]:
    """Play the touches; print and return what both recognisers say."""
    if command.pairs < 1 or command.seed < 0:
        raise DeviceError(
            f"--pairs is {command.pairs} and --seed {command.seed}; allowed are pairs "
            "of 1 and above and seeds of 0 and above"
        )
    models = load_model(command.model), load_model(BLIND_MODEL)
    found = []
    for touch in draw_touches(command.pairs, command.seed):
        posed, blind = (
            (recognise_touch(touch, 0, model), recognise_touch(touch, 1, model))
            for model in models
        )
        found.append(PoseComparison(touch.labels, posed, blind))
    for number, each in enumerate(found):
        print(f"touch {number + 1}: {each.labels[0]}, then {each.labels[1]}")
        for pose, (one, other) in (("with", each.posed), ("without", each.blind)):
            answers = "; then ".join(", ".join(answer.texts) for answer in (one, other))
            print(f"  {pose} the pose: {answers}")
    counts = {
        "playings": 2 * len(found),
        "posed_right": sum(each.count_correct(each.posed) for each in found),
        "blind_right": sum(each.count_correct(each.blind) for each in found),
        "blind_same": sum(each.blind_is_equal for each in found),
    }
    print(
        f"with the pose {counts['posed_right']} of {counts['playings']} are correct, "
        f"without it {counts['blind_right']}, and both answers are the same for "
        f"{counts['blind_same']} of {format_count(len(found), 'touch')}"
    )
    rows = [
        {
            "labels": each.labels,
            "posed": [answer.detected for answer in each.posed],
            "blind": [answer.detected for answer in each.blind],
        }
        for each in found
    ]
    return {**counts, "pairs": rows}


if __name__ == "__main__":
    sys.exit(run_program(main))
