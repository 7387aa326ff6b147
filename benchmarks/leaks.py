"""Whether anything tells the answer that should not.

python -m benchmarks.leaks --train SET/train --test SET/test: learns from labels that
are shuffled, and from windows without the touch itself: all readings from the first
contact on are replaced by the last one before it. Either way a method that is asked
fairly is at chance on the test. Which people, pose groups and sensor builds the sets
share is a test of the project (`tests/test_sim_sets.py`): none between `train` and the
builds and people of `test-x` and `test-m`; all between the two parts of a paper-size
set, as in the paper, but for the day.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Float, Int

from eskin.learn.baselines import Clips, make_baseline
from eskin.learn.clip_scoring import answer_clips
from eskin.learn.comparison import Examples, find_examples
from eskin.learn.comparison.methods import FOR_SMALL_SETS
from eskin.learn.metrics import wilson_interval
from eskin.learn.training import Trainer
from eskin.recording import NONE, read_recording

WHOLE_SKIN = ("svm-bins", "lda-bins", "knn-max", "gradient-boosting")


@dataclass(frozen=True)
class Command:
    """Learn what cannot be learned."""

    train: Path
    """A set of clips to learn from."""

    test: Path
    """Another, to answer."""

    pack: Path = Path("pack")
    """Folder that keeps prepared clips."""

    seed: int = 0
    """Decides how labels are shuffled, and what is drawn in training."""


def show(command: Command) -> None:
    """Print the table."""
    train, test = (
        find_examples([place], command.pack) for place in (command.train, command.test)
    )
    names = train.gestures
    truth = test.truth(names)
    chance = np.bincount(truth).max() / len(truth)
    print(f"chance: {1 / len(names):.1%}, the commonest class: {chance:.1%}\n")
    print("| method | labels shuffled (95 %) | before contact only (95 %) |")
    print("|---|---|---|")
    shuffled = np.random.default_rng(command.seed).permutation(train.truth(names))
    before = windows_before_contact(train), windows_before_contact(test)
    for name in WHOLE_SKIN:
        cells = []
        for windows, asked, labels in (
            (train.windows, test.windows, shuffled),
            (*before, train.truth(names)),
        ):
            baseline = make_baseline(name, train.mounted)
            baseline.fit(windows, labels, command.seed)
            said = baseline.predict_probabilities(asked).argmax(axis=1)
            cells.append(share(said, truth))
        print(f"| {name} | {cells[0]} | {cells[1]} |", flush=True)
    print(f"| eskin | {share(ours_shuffled(train, test, command.seed), truth)} | |")


def share(said: Int[np.ndarray, "clip"], truth: Int[np.ndarray, "clip"]) -> str:
    """Share of right answers with its interval."""
    right = int((said == truth).sum())
    low, high = wilson_interval(right, len(truth))
    return f"{right / len(truth):.1%} ({low:.1%}-{high:.1%})"


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
    network = Trainer(wrong, vocabulary, FOR_SMALL_SETS, seed=seed).run()
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
