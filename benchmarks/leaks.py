"""Whether anything tells the answer that should not.

python -m benchmarks.leaks --train SET/train ... --test SET/test ...: learns from
labels that are shuffled, and from windows without the touch itself: all readings from
the first contact on are replaced by the last one before it. Either way a method that is
asked fairly is at chance on the test of each pair of sets. One pair says little: a clip
that is near to many others may be right for all of them by luck. Which people, pose
groups and sensor builds the sets share is a test of the project
(`tests/test_sim_sets.py`): none between `train` and the builds and people of `test-x`
and `test-m`; all between the two parts of a paper-size set, as in the paper, but for
the day.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Float, Int
from scipy.stats import t

from eskin.learn.baselines import Clips, make_baseline
from eskin.learn.clip_scoring import answer_clips
from eskin.learn.comparison import Examples, find_examples
from eskin.learn.comparison.methods import FOR_SMALL_SETS
from eskin.learn.training import Trainer
from eskin.recording import NONE, read_recording

WHOLE_SKIN = ("svm-bins", "lda-bins", "knn-max", "gradient-boosting")


@dataclass(frozen=True)
class Command:
    """Learn what cannot be learned."""

    train: tuple[Path, ...]
    """Sets of clips to learn from, each for itself."""

    test: tuple[Path, ...]
    """Another to answer, for each of them."""

    pack: Path = Path("pack")
    """Folder that keeps prepared clips."""

    seed: int = 0
    """Decides how labels are shuffled, and what is drawn in training."""


def show(command: Command) -> None:
    """Print the table."""
    shuffled: dict[str, list[float]] = {}
    before: dict[str, list[float]] = {}
    for n, places in enumerate(zip(command.train, command.test, strict=True)):
        train, test = (find_examples([place], command.pack) for place in places)
        seed = command.seed + n
        truth = test.truth(train.gestures)
        labels = train.truth(train.gestures)
        mixed = np.random.default_rng(seed).permutation(labels)
        cut = windows_before_contact(train), windows_before_contact(test)
        for name in WHOLE_SKIN:
            for shares, windows, asked, learned in (
                (shuffled, train.windows, test.windows, mixed),
                (before, *cut, labels),
            ):
                baseline = make_baseline(name, train.mounted)
                baseline.fit(windows, learned, seed)
                said = baseline.predict_probabilities(asked).argmax(axis=1)
                shares.setdefault(name, []).append(float((said == truth).mean()))
        said = ours_shuffled(train, test, seed)
        shuffled.setdefault("eskin", []).append(float((said == truth).mean()))
    print(f"{len(command.train)} pairs of sets of four gestures: chance is 25 %\n")
    print("| method | labels shuffled (95 %) | before contact only (95 %) |")
    print("|---|---|---|")
    for name, shares in shuffled.items():
        print(f"| {name} | {spread(shares)} | {spread(before.get(name, []))} |")


def spread(shares: Sequence[float]) -> str:
    """The mean over pairs of sets, with the interval that their spread gives it."""
    if len(shares) < 2:
        return "".join(f"{share:.1%}" for share in shares)
    mean, count = float(np.mean(shares)), len(shares)
    half = float(t.ppf(0.975, count - 1) * np.std(shares, ddof=1) / np.sqrt(count))
    return f"{mean:.1%} ({mean - half:.1%}-{mean + half:.1%})"


def ours_shuffled(
    train: Examples, test: Examples, seed: int
) -> Int[np.ndarray, "clip"]:
    """What the recogniser answers that learned from shuffled labels."""
    dataset = train.dataset(FOR_SMALL_SETS.graph)
    made = [n for n, each in enumerate(dataset.segments) if each.gesture != NONE]
    others = np.random.default_rng(seed).permutation(made).tolist()
    segments = list(dataset.segments)
    for n, other in zip(made, others, strict=True):
        gesture = dataset.segments[other].gesture
        segments[n] = replace(dataset.segments[n], gesture=gesture)
    vocabulary = (NONE, *(name for name in train.gestures if name != NONE))
    wrong = replace(dataset, segments=tuple(segments))
    network = Trainer(wrong, vocabulary, FOR_SMALL_SETS, seed=seed).run(quiet=True)
    answers = answer_clips(network, test.dataset(FOR_SMALL_SETS.graph), vocabulary)
    columns = [vocabulary.index(name) for name in train.gestures]
    return answers.log_chances[:, columns].argmax(axis=1)


def windows_before_contact(examples: Examples) -> Clips:
    """Windows that stay as they were just before the first true contact."""
    windows = examples.windows
    pressure, q = windows.pressure.copy(), windows.q.copy()
    for n, onset in enumerate(onsets(examples)):
        first = int(np.clip(onset, 1, pressure.shape[1]))
        pressure[n, first:] = pressure[n, first - 1]
        q[n, first:] = q[n, first - 1]
    return Clips(pressure, q)


def onsets(examples: Examples) -> Float[np.ndarray, "clip"]:
    """Slot of the first true contact of each clip; infinite where there is none."""
    stamps = [
        np.unique([truth.stamp for truth in read_recording(path).truths()])
        for path in examples.paths
    ]
    found = []
    for n, clip in examples.every:
        inside = stamps[n][(stamps[n] >= clip.start) & (stamps[n] < clip.end)]
        since = inside[0] - clip.start if len(inside) else np.inf
        found.append(
            since * examples.windows.pressure.shape[1] / (clip.end - clip.start)
        )
    return np.floor(np.array(found, dtype=np.float64))


if __name__ == "__main__":
    show(tyro.cli(Command))
