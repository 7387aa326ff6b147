"""Test for leaks: whether anything but the touch predicts the answer.

python -m lab.leaks --train SET/train ... --test SET/test ...: methods are
trained on shuffled labels, and on windows without the touch: all readings from the
first contact on are replaced by the last one before it; clips that begin in contact are
left out. Without a leak, accuracy is at chance on the test of each pair of sets. The
command exits with 1 if an accuracy exceeds chance with p < 0.001. One pair is little
evidence, because clips that resemble many others may be right by chance.
`tests/test_sim_sets.py` tests which people, pose groups and sensor builds sets share:
`train` shares none with the builds and people of `test-x` and `test-m`; the two parts
of a paper-size set share all but the day.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Bool, Float, Int
from scipy.stats import binomtest, t

from eskin.learn.evaluation import predict_clips
from eskin.learn.training import TrainConfig, Trainer
from eskin.recording import NONE, read_recording
from lab.baselines import SkinWindows, build_baseline
from lab.comparison import Examples, find_examples
from lab.comparison.methods import FOR_SMALL_SETS

Right = Bool[np.ndarray, "clip"]
"""Correctness of each answer."""

CHANCE = 0.25
"""Accuracy of a guess among four gestures."""

SHUFFLED, BEFORE = "shuffled labels", "readings before contact"
WHOLE_SKIN = ("svm-bins", "lda-bins", "knn-max", "gradient-boosting")


@dataclass(frozen=True)
class Command:
    """Train on data that predict nothing."""

    train: tuple[Path, ...]
    """Training sets, each used on its own."""

    test: tuple[Path, ...]
    """Test set of each training set."""

    pack: Path = Path("pack")
    """Folder of prepared clips."""

    seed: int = 0
    """Seed of the shuffled labels and of the training."""

    steps: int | None = None
    """Number of training steps of our network; that of its settings if None."""

    @property
    def config(self) -> TrainConfig:
        """Return the settings of the training of our network."""
        if self.steps is None:
            return FOR_SMALL_SETS
        return replace(FOR_SMALL_SETS, epochs=1, steps=self.steps)


def show(command: Command) -> None:
    """Print the table, and exit with 1 if an accuracy exceeds chance."""
    found: dict[tuple[str, str], list[Right]] = {}
    for n, places in enumerate(zip(command.train, command.test, strict=True)):
        train, test = (find_examples([place], command.pack) for place in places)
        for case, right in answers(train, test, command.seed + n, command.config):
            found.setdefault(case, []).append(right)
    print(f"{len(command.train)} pairs of sets of four gestures: chance is 25 %\n")
    print("| method | labels shuffled (95 %) | before contact only (95 %) |")
    print("|---|---|---|")
    for name in (*WHOLE_SKIN, "eskin"):
        cells = [spread(found.get((name, way), [])) for way in (SHUFFLED, BEFORE)]
        print(f"| {name} | {' | '.join(cells)} |")
    for (name, way), rights in found.items():
        check_chance(f"{name} from {way}", np.concatenate(rights))


def answers(
    train: Examples,
    test: Examples,
    seed: int,
    config: TrainConfig = FOR_SMALL_SETS,
) -> Iterator[tuple[tuple[str, str], Right]]:
    """Yield the correctness of answers, by method and training data."""
    truth, labels = test.truth(train.gestures), train.truth(train.gestures)
    mixed = np.random.default_rng(seed).permutation(labels)
    (cut, learned), (asked, which) = map(windows_before_contact, (train, test))
    for name in WHOLE_SKIN:
        for way, windows, taught, others, true in (
            (SHUFFLED, train.windows, mixed, test.windows, truth),
            (BEFORE, cut, labels[learned], asked, truth[which]),
        ):
            baseline = build_baseline(name, train.mounted)
            baseline.fit(windows, taught, seed)
            predicted = baseline.predict_probabilities(others).argmax(axis=1)
            yield (name, way), predicted == true
    yield ("eskin", SHUFFLED), ours_shuffled(train, test, seed, config) == truth


def check_chance(who: str, right: Right) -> None:
    """Exit with a message if an accuracy exceeds chance with p < 0.001."""
    found = binomtest(int(right.sum()), len(right), CHANCE, alternative="greater")
    if found.pvalue < 0.001:
        raise SystemExit(
            f"{who}: {right.mean():.1%} of {len(right)} right; allowed is chance, "
            f"{CHANCE:.0%}; find what tells the answer"
        )


def spread(rights: Sequence[Right]) -> str:
    """Format the mean accuracy over pairs of sets, with its confidence interval."""
    shares = [float(right.mean()) for right in rights]
    if len(shares) < 2:
        return "".join(f"{share:.1%}" for share in shares)
    mean, count = float(np.mean(shares)), len(shares)
    half = float(t.ppf(0.975, count - 1) * np.std(shares, ddof=1) / np.sqrt(count))
    return f"{mean:.1%} ({mean - half:.1%}-{mean + half:.1%})"


def ours_shuffled(
    train: Examples,
    test: Examples,
    seed: int,
    config: TrainConfig = FOR_SMALL_SETS,
) -> Int[np.ndarray, "clip"]:
    """Return the answers of a recogniser trained on shuffled labels."""
    dataset = train.dataset(config.graph)
    made = [n for n, each in enumerate(dataset.segments) if each.gesture != NONE]
    others = np.random.default_rng(seed).permutation(made).tolist()
    segments = list(dataset.segments)
    for n, other in zip(made, others, strict=True):
        gesture = dataset.segments[other].gesture
        segments[n] = replace(dataset.segments[n], gesture=gesture)
    vocabulary = (NONE, *(name for name in train.gestures if name != NONE))
    wrong = replace(dataset, segments=tuple(segments))
    network = Trainer(wrong, vocabulary, config, seed=seed).run(quiet=True)
    answers = predict_clips(network, test.dataset(config.graph), vocabulary)
    columns = [vocabulary.index(name) for name in train.gestures]
    return answers.log_probabilities[:, columns].argmax(axis=1)


def windows_before_contact(
    examples: Examples,
) -> tuple[SkinWindows, Int[np.ndarray, "window"]]:
    """Return windows that keep the reading before the first true contact.

    Returns:
        The windows, and the indices of their clips, which do not begin in contact.
    """
    since = onsets(examples)
    chosen = np.flatnonzero(since >= 1)
    windows = examples.windows
    pressure, q = windows.pressure[chosen], windows.q[chosen]
    for n, onset in enumerate(since[chosen]):
        first = int(min(onset, pressure.shape[1]))
        pressure[n, first:] = pressure[n, first - 1]
        q[n, first:] = q[n, first - 1]
    return SkinWindows(pressure, q), chosen


def onsets(examples: Examples) -> Float[np.ndarray, "clip"]:
    """Return the slot of the first true contact of each clip; infinite without one."""
    stamps = [
        np.unique([truth.stamp for truth in read_recording(path).truths()])
        for path in examples.paths
    ]
    found = []
    for n, clip in examples.clips:
        inside = stamps[n][(stamps[n] >= clip.start) & (stamps[n] < clip.end)]
        since = inside[0] - clip.start if len(inside) else np.inf
        found.append(
            since * examples.windows.pressure.shape[1] / (clip.end - clip.start)
        )
    return np.floor(np.array(found, dtype=np.float64))


if __name__ == "__main__":
    show(tyro.cli(Command))
