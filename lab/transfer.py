"""Test weights zero-shot on people and a sensor of a public data set.

    python -m lab.transfer
    python -m lab.transfer shearsense --model FILE

Every repetition of a public set is played to the recogniser as by a live device:
resampled, between rest before and after, with assumed values of the pitch and the full
scale, which the set does not state. Nothing is trained. The answer is a forced choice:
the most probable class of the touch of largest impulse, 0.1 s after its last contact,
from the 2 s before; `none` without a touch. By then one pat may still become two; a
second choice is taken as the touch closes, when no second pat can follow.

`lab.public_sets` reads the sets and says which of their gestures have a class.
"""

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
import tyro
from jaxtyping import Float

from eskin import Model, Recognizer, load_model
from eskin.recording import NONE
from eskin.robot import load_robot
from eskin.skin import MountedSkin, build_grid_skin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S
from lab.public_sets import SETS, TOUCHED, Group, PublicSet, Trial, read_trials
from lab.tables import format_head, format_row

START = 1_000 * NS_PER_S
"""Stamp of the first scan of every trial [ns]."""

REST_BEFORE = 1.5
"""Rest before a trial, for taring, as in simulated recordings [s]."""

REST_AFTER = 0.6
"""Rest after a trial, longer than a touch stays open without contact [s]."""

RATE = 50.0
"""Rate of the scans [Hz]."""

FINEST = 4080
"""Counts at full scale, about those of a 12-bit converter."""

ANSWER_AFTER = round(0.1 * NS_PER_S)
"""Time from the last contact to the forced choice [ns]."""

DataSet = Literal["socialtouch", "socialtouch-groups", "phone", "shearsense", "sleeve"]


@dataclass(frozen=True)
class TrialAnswer:
    """Holds the answers of the recogniser to one trial."""

    subject: str
    """Name of the person."""
    gesture: str
    """Name in the set."""
    forced: str
    """Forced choice."""
    closed: str
    """Forced choice as the touch closes."""
    seconds: float
    """Time from the first to the last touched reading of the trial [s]."""


@dataclass(frozen=True)
class Command:
    """Test weights zero-shot on a public set."""

    dataset: tyro.conf.Positional[DataSet] = "socialtouch"
    """Data set; `socialtouch-groups` is for weights of its 12 groups of gestures."""
    data: Path | None = None
    """Folder of the set, as downloaded; in ../shared/data unless given."""
    people: tuple[str, ...] = ()
    """People to test on, as in P0; all unless given."""
    model: Path = Path("ur5")
    """Name of weights that come with eskin, or a model file."""
    floor: float | None = None
    """Share of full scale below which a signal is not a touch, as in a calibration; by
    default that of the set."""


def main() -> None:
    """Test the weights and print the table."""
    command = tyro.cli(Command)
    started = time.monotonic()
    public = SETS[command.dataset]
    model = load_model(command.model)
    if command.floor is not None:
        public = replace(public, floor=command.floor)
    trials = read_trials(public, command.data or public.folder, command.people)
    answers = answer_trials(trials, public, model)
    print(format_forced_table(answers, public.groups, model))
    print(f"\n{time.monotonic() - started:.0f} s")


def answer_trials(
    trials: Iterable[Trial], public: PublicSet, model: Model
) -> list[TrialAnswer]:
    """Recognise every trial with a fresh recogniser."""
    pitch = public.pitch_mm / 1000
    scale = public.full_scale_kpa
    skin = build_grid_skin(public.rows, public.columns, pitch, calibrated=True)
    mounted = MountedSkin(skin, load_robot("table"))
    calibration = Calibration.uniform(
        skin.count, FINEST, scale, floor=public.floor * scale
    )
    return [answer(trial, Recognizer(model, mounted, calibration)) for trial in trials]


def touched_seconds(trial: Trial) -> float:
    """Return the time from the first to the last touched reading of a trial [s]."""
    touched = trial.seconds[trial.share.max(axis=1) >= TOUCHED]
    return float(np.ptp(touched)) if len(touched) else 0.0


def build_scans(trial: Trial) -> Iterator[Scan]:
    """Yield the scans of a trial between rest, as from a live device.

    Pressures are interpolated in time between the readings, from rest to the first and
    from the last to rest.
    """
    period = float(np.median(np.diff(trial.seconds)))
    first, last = trial.seconds[0] - period, trial.seconds[-1] + period
    known = np.array(
        [first - REST_BEFORE, first, *trial.seconds, last, last + REST_AFTER]
    )
    share = np.pad(trial.share, ((2, 2), (0, 0)))
    times = np.arange(known[0], known[-1], 1 / RATE)
    before = np.minimum(np.searchsorted(known, times, "right"), len(known) - 1) - 1
    part = ((times - known[before]) / np.diff(known)[before])[:, None]
    between = (1 - part) * share[before] + part * share[before + 1]
    received = np.ones(between.shape[1], dtype=np.bool_)
    for number, counts in enumerate(np.rint(FINEST * between).astype(np.int32)):
        stamp = START + round(number * NS_PER_S / RATE)
        yield Scan(stamp, counts, received, np.empty(0))


@dataclass(eq=False)
class TouchTrace:
    """Holds the probabilities of one touch at each reading while it is open."""

    last: int
    """Stamp of its last contact so far [ns]."""
    stamps: list[int]
    """Stamps of its readings [ns]."""
    probabilities: list[Float[np.ndarray, "class"]]
    """Probabilities at each reading, from the 2 s before."""
    closing: Float[np.ndarray, "class"] = field(default_factory=lambda: np.empty(0))
    """Probabilities at the latest reading that count if the touch closes after it."""
    impulse: float = 0.0
    """Force integrated over time [N s]."""

    @property
    def forced(self) -> Float[np.ndarray, "class"]:
        """Probabilities just after the last contact, at the latest as it closes."""
        due = np.searchsorted(self.stamps, self.last + ANSWER_AFTER)
        return self.probabilities[min(int(due), len(self.stamps) - 1)]


def trace_touches(trial: Trial, recognizer: Recognizer) -> dict[int, TouchTrace]:
    """Recognise a trial; return its touches by id, but for those merged into others."""
    traces: dict[int, TouchTrace] = {}
    merged: set[int] = set()
    for scan in build_scans(trial):
        recognizer.push(scan)
        state = recognizer.state
        assert state is not None
        for touch in state.open:
            trace = traces.setdefault(touch.id, TouchTrace(0, [], []))
            trace.last = touch.last
            trace.stamps.append(scan.stamp)
            trace.probabilities.append(recognizer.probabilities[touch.id])
            classifier = recognizer.classifier
            key = classifier.get_key(touch.id)
            trace.closing = classifier.closing_probabilities[key]
        for row in state.rows:
            if row.id in traces:
                traces[row.id].impulse = row.impulse
            if row.merged_into:
                merged.add(row.id)
    recognizer.finish()
    return {key: trace for key, trace in traces.items() if key not in merged}


def answer(trial: Trial, recognizer: Recognizer) -> TrialAnswer:
    """Recognise one trial."""
    traces = trace_touches(trial, recognizer).values()
    touch = max(traces, key=lambda trace: trace.impulse, default=None)
    seconds = touched_seconds(trial)
    if touch is None:
        return TrialAnswer(trial.subject, trial.gesture, NONE, NONE, seconds)
    names = recognizer.model.card.vocabulary
    forced = names[touch.forced.argmax()]
    closed = names[touch.closing.argmax()]
    return TrialAnswer(trial.subject, trial.gesture, forced, closed, seconds)


def select_answers(answers: Iterable[TrialAnswer], group: Group) -> list[TrialAnswer]:
    """Return the answers that count for a group."""
    return [
        answer
        for answer in answers
        if answer.gesture in group.gestures
        and group.longer <= answer.seconds < group.shorter
    ]


def format_forced_table(
    answers: Sequence[TrialAnswer], groups: Iterable[Group], model: Model
) -> str:
    """Format a table of the forced choices, by group and person."""
    names = model.card.vocabulary
    heads = ("forced choice of", "truth", "n", *names, "accuracy")
    rows = ["\n" + format_head((*heads, "accuracy as it closes"))]
    for group in groups:
        inside = select_answers(answers, group)
        parts = {group.name: inside}
        for person in sorted({answer.subject for answer in inside}):
            parts[f"- {person}"] = [a for a in inside if a.subject == person]
        for name, part in parts.items():
            truth = (group.truth or "") if part is inside else ""
            cells = [name, truth, str(len(part))]
            cells += [format_percent(share(a.forced == n for a in part)) for n in names]
            rights = (compute_accuracy(part, group, closed) for closed in (False, True))
            rows.append(format_row([*cells, *map(format_percent, rights)]))
    return "\n".join(rows)


def compute_accuracy(
    answers: Iterable[TrialAnswer], group: Group, closed: bool = False
) -> float | None:
    """Return the share of true choices; None without a true class or answers.

    Args:
        answers: answers of the group.
        group: group with the true class.
        closed: whether choices are taken as the touch closes.
    """
    if group.truth is None:
        return None
    return share((a.closed if closed else a.forced) == group.truth for a in answers)


def share(found: Iterable[bool]) -> float | None:
    """Return the share of true values; None without values."""
    values = list(found)
    return sum(values) / len(values) if values else None


def format_percent(part: float | None) -> str:
    """Format a share; empty for None."""
    return "" if part is None else f"{part:.1%}"


if __name__ == "__main__":
    main()
