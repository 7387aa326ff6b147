"""Test weights zero-shot on people and a sensor of a public data set.

    python -m lab.transfer
    python -m lab.transfer --model FILE --json FILE
    python -m lab.transfer --sweep

Every repetition of a public set is played to the recogniser as by a live device:
resampled, between rest before and after, with assumed values of the pitch and the full
scale, which the set does not state. Nothing is trained. There are two kinds of answer:

- forced choice, the main result: the most probable class of the touch of largest
  impulse, 0.1 s after its last contact, from the 2 s before; `none` without a touch. By
  then one pat may still become two; a second choice is taken as the touch closes, when
  no second pat can follow.
- live: the detections of the recogniser, of any touch.

`lab.public_sets` reads the sets and says which of their gestures have a class.
"""

import itertools
import json
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from jaxtyping import Float

from eskin import Detection, Model, Recognizer, load_model
from eskin.recording import NONE
from eskin.robot import load_robot
from eskin.skin import MountedSkin, build_grid_skin
from eskin.touch import Calibration, Scan, TouchState
from eskin.units import NS_PER_S
from lab.public_sets import SETS, TOUCHED, Group, PublicSet, Trial, read_trials
from lab.tables import format_head, format_row

START = 1_000 * NS_PER_S
"""Stamp of the first scan of every trial [ns]."""

REST_BEFORE = 1.5
"""Rest before a trial, for taring, as in simulated recordings [s]."""

REST_AFTER = 0.6
"""Rest after a trial, longer than a touch stays open without contact [s]."""

FINEST = 4080
"""Counts at full scale, about those of a 12-bit converter."""

ANSWER_AFTER = round(0.1 * NS_PER_S)
"""Time from the last contact to the forced choice [ns]."""

DataSet = Literal["socialtouch", "socialtouch-groups", "shearsense", "sleeve"]

UNKNOWN, NOTHING = "unknown", "nothing"

SWEEP_PITCHES = (4.0, 6.0, 10.0)
SWEEP_SCALES = (20.0, 40.0, 100.0)


@dataclass(frozen=True)
class TransferSetting:
    """Sets what a public set does not state."""

    pitch_mm: float
    """Distance of neighbouring taxels [mm]."""
    full_scale_kpa: float
    """Pressure at full scale [kPa]."""
    rate: float
    """Rate of the scans [Hz]."""
    floor: float = 0.0
    """Share of full scale below which a signal is not a touch."""


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
    detected: tuple[str, ...]
    """Live detections, with `unknown`, without `none`."""
    seconds: float
    """Time from the first to the last touched reading of the trial [s]."""

    @property
    def gestures(self) -> set[str]:
        """Gestures that were detected live."""
        return set(self.detected) - {UNKNOWN}


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
    pitch_mm: float | None = None
    """Assumed distance of neighbouring taxels [mm]; by default that of the set."""
    full_scale_kpa: float | None = None
    """Assumed pressure at full scale [kPa]; by default that of the set."""
    rate: float = 50.0
    """Rate of the scans [Hz]."""
    floor: float | None = None
    """Share of full scale below which a signal is not a touch, as in a calibration; by
    default that of the set."""
    headline: bool = False
    """Play only the groups with a required accuracy, in a third of the time."""
    sweep: bool = False
    """Repeat the groups with a required accuracy, or with a true class where no group
    has a requirement, over pitches and full scales."""
    json: Path | None = None
    """Path of a JSON file with all results."""


def main() -> None:
    """Test the weights and print the tables."""
    command = tyro.cli(Command)
    started = time.monotonic()
    public, model = SETS[command.dataset], load_model(command.model)
    if command.headline:
        public = public.headline
    setting = TransferSetting(
        get_or(command.pitch_mm, public.pitch_mm),
        get_or(command.full_scale_kpa, public.full_scale_kpa),
        command.rate,
        get_or(command.floor, public.floor),
    )
    trials = read_trials(public, command.data or public.folder, command.people)
    answers = answer_trials(trials, public, model, setting)
    groups = {
        group.name: compute_results(answers, group, model) for group in public.groups
    }
    result: dict[str, Any] = {
        "dataset": command.dataset,
        "model": str(command.model),
        "setting": asdict(setting),
        "groups": groups,
        "gestures": compute_gesture_results(answers, public, model),
    }
    print(format_forced_table(groups, model))
    print(format_live_table(groups, model), flush=True)
    if command.sweep:
        result["sweep"] = sweep(trials, public, model, setting)
        print(format_sweep_table(result["sweep"]))
    if command.json is not None:
        command.json.write_text(json.dumps(result, indent=1) + "\n")
    print(f"\n{time.monotonic() - started:.0f} s")


def get_or(value: float | None, default: float) -> float:
    """Return a value, or the default where it is None."""
    return default if value is None else value


def answer_trials(
    trials: Iterable[Trial], public: PublicSet, model: Model, setting: TransferSetting
) -> list[TrialAnswer]:
    """Recognise every trial with a fresh recogniser."""
    pitch = setting.pitch_mm / 1000
    skin = build_grid_skin(public.rows, public.columns, pitch, calibrated=True)
    mounted = MountedSkin(skin, load_robot("table"))
    scale = setting.full_scale_kpa
    calibration = Calibration.uniform(
        skin.count, FINEST, scale, floor=setting.floor * scale
    )
    return [
        answer(trial, Recognizer(model, mounted, calibration), setting.rate)
        for trial in trials
    ]


def answer(trial: Trial, recognizer: Recognizer, rate: float) -> TrialAnswer:
    """Recognise one trial."""
    touches = TouchTraces(recognizer)
    for scan in build_scans(trial, rate):
        touches.push(scan)
    touches.finish()
    detected = {detection.gesture for detection in touches.detections} - {NONE}
    touch = touches.largest()
    seconds = touched_seconds(trial)
    found = TrialAnswer(
        trial.subject, trial.gesture, NONE, NONE, tuple(sorted(detected)), seconds
    )
    if touch is None:
        return found
    names = recognizer.model.card.vocabulary
    return replace(
        found,
        forced=names[touch.forced.argmax()],
        closed=names[touch.probabilities[-1].argmax()],
    )


def touched_seconds(trial: Trial) -> float:
    """Return the time from the first to the last touched reading of a trial [s]."""
    touched = trial.seconds[trial.share.max(axis=1) >= TOUCHED]
    return float(np.ptp(touched)) if len(touched) else 0.0


def build_scans(trial: Trial, rate: float) -> Iterator[Scan]:
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
    times = np.arange(known[0], known[-1], 1 / rate)
    before = np.minimum(np.searchsorted(known, times, "right"), len(known) - 1) - 1
    part = ((times - known[before]) / np.diff(known)[before])[:, None]
    between = (1 - part) * share[before] + part * share[before + 1]
    received = np.ones(between.shape[1], dtype=np.bool_)
    for number, counts in enumerate(np.rint(FINEST * between).astype(np.int32)):
        stamp = START + round(number * NS_PER_S / rate)
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
    impulse: float = 0.0
    """Force integrated over time [N s]."""

    @property
    def forced(self) -> Float[np.ndarray, "class"]:
        """Probabilities just after the last contact, at the latest as it closes."""
        due = np.searchsorted(self.stamps, self.last + ANSWER_AFTER)
        return self.probabilities[min(int(due), len(self.stamps) - 1)]


class TouchTraces:
    """Collects the probabilities and detections of one trial."""

    def __init__(self, recognizer: Recognizer) -> None:
        """Start before the first scan."""
        self.recognizer = recognizer
        self.traces: dict[int, TouchTrace] = {}
        self.merged: set[int] = set()
        self.detections: list[Detection] = []

    def push(self, scan: Scan) -> None:
        """Process the next scan."""
        self.detections += self.recognizer.push(scan)
        state = self.recognizer.state
        assert state is not None
        for touch in state.open:
            trace = self.traces.setdefault(touch.id, TouchTrace(0, [], []))
            trace.last = touch.last
            trace.stamps.append(scan.stamp)
            trace.probabilities.append(self.recognizer.probabilities[touch.id])
        if state.closed:
            self.weigh(state)

    def finish(self) -> None:
        """Close the open touches."""
        if self.recognizer.state is not None:
            self.weigh(self.recognizer.state)
        self.detections += self.recognizer.finish()

    def weigh(self, state: TouchState) -> None:
        """Store the impulses of all touches, and which were merged into another."""
        for row in state.rows:
            if row.id in self.traces:
                self.traces[row.id].impulse = row.impulse
            if row.merged_into:
                self.merged.add(row.id)

    def largest(self) -> TouchTrace | None:
        """Return the touch of largest impulse; None without a touch."""
        whole = [self.traces[key] for key in self.traces.keys() - self.merged]
        return max(whole, key=lambda trace: trace.impulse, default=None)


def select_answers(answers: Iterable[TrialAnswer], group: Group) -> list[TrialAnswer]:
    """Return the answers that count for a group."""
    return [
        answer
        for answer in answers
        if answer.gesture in group.gestures
        and group.longer <= answer.seconds < group.shorter
    ]


def compute_results(
    answers: Sequence[TrialAnswer], group: Group, model: Model
) -> dict[str, object]:
    """Compute the results of a group, and of each person in it."""
    inside = select_answers(answers, group)
    people = sorted({answer.subject for answer in inside})
    return {
        "gestures": group.gestures,
        "truth": group.truth,
        "bar": group.bar,
        **compute_shares(inside, group.truth, model),
        "people": {
            person: compute_shares(
                [a for a in inside if a.subject == person], group.truth, model
            )
            for person in people
        },
    }


def compute_gesture_results(
    answers: Sequence[TrialAnswer], public: PublicSet, model: Model
) -> dict[str, dict[str, object]]:
    """Compute the results of every gesture of the set, for trials of any duration."""
    return {
        gesture: compute_shares(
            [a for a in answers if a.gesture == gesture], group.truth, model
        )
        for group in public.groups
        for gesture in group.gestures
    }


def compute_shares(
    answers: Sequence[TrialAnswer], truth: str | None, model: Model
) -> dict[str, object]:
    """Compute the share of each answer, and the accuracy where there is a true class.

    Live, a trial is right if the true gesture was detected at least once (without a
    gesture if the truth is `none`), and wrong if another one was; it can be both.
    """
    names = model.card.vocabulary
    live = (*(name for name in names if name != NONE), UNKNOWN)
    found: dict[str, object] = {
        "n": len(answers),
        "forced": {n: share(a.forced == n for a in answers) for n in names},
        "closed": {n: share(a.closed == n for a in answers) for n in names},
        "live": {n: share(n in a.detected for a in answers) for n in live}
        | {NOTHING: share(not a.gestures for a in answers)},
    }
    if truth is not None:
        found["forced_right"] = share(a.forced == truth for a in answers)
        found["closed_right"] = share(a.closed == truth for a in answers)
        found["live_right"] = share(
            truth in a.detected if truth != NONE else not a.gestures for a in answers
        )
        found["live_wrong"] = share(bool(a.gestures - {truth}) for a in answers)
    return found


def share(found: Iterable[bool]) -> float | None:
    """Return the share of true values; None without values."""
    values = list(found)
    return sum(values) / len(values) if values else None


def format_forced_table(found: Mapping[str, Mapping[str, Any]], model: Model) -> str:
    """Format a table of the forced choices, by group and person."""
    names = model.card.vocabulary
    heads = ("forced choice of", "truth", "n", *names, "accuracy", "required")
    heads += ("accuracy as it closes",)
    rows = ["\n" + format_head(heads)]
    for name, truth, bar, part in iterate_rows(found):
        cells = [name, truth, str(part["n"])]
        cells += [format_percent(part["forced"][n]) for n in names]
        cells += [format_percent(part.get("forced_right")), format_percent(bar)]
        rows.append(format_row([*cells, format_percent(part.get("closed_right"))]))
    return "\n".join(rows)


def format_live_table(found: Mapping[str, Mapping[str, Any]], model: Model) -> str:
    """Format a table of the live detections, by group and person."""
    names = (*(n for n in model.card.vocabulary if n != NONE), UNKNOWN, NOTHING)
    rows = [
        "\n" + format_head(("detected live", "truth", "n", *names, "right", "wrong"))
    ]
    for name, truth, _, part in iterate_rows(found):
        cells = [name, truth, str(part["n"])]
        cells += [format_percent(part["live"][n]) for n in names]
        cells += [format_percent(part.get(key)) for key in ("live_right", "live_wrong")]
        rows.append(format_row(cells))
    return "\n".join(rows)


def iterate_rows(
    found: Mapping[str, Mapping[str, Any]],
) -> Iterator[tuple[str, str, float | None, Mapping[str, Any]]]:
    """Yield name, truth, required accuracy and results of each group and its people."""
    for name, group in found.items():
        yield name, group["truth"] or "", group["bar"], group
        for person, part in group["people"].items():
            yield f"- {person}", "", None, part


def sweep(
    trials: Sequence[Trial], public: PublicSet, model: Model, usual: TransferSetting
) -> list[dict[str, Any]]:
    """Compute the accuracy of groups with a requirement, by pitch and full scale."""
    groups = public.headline.groups
    wanted = {gesture for group in groups for gesture in group.gestures}
    chosen = [trial for trial in trials if trial.gesture in wanted]
    found = []
    for pitch, scale in itertools.product(SWEEP_PITCHES, SWEEP_SCALES):
        setting = replace(usual, pitch_mm=pitch, full_scale_kpa=scale)
        answers = answer_trials(chosen, public, model, setting)
        right = {
            g.name: compute_results(answers, g, model)["forced_right"] for g in groups
        }
        found.append(asdict(setting) | {"forced_right": right})
    return found


def format_sweep_table(found: Sequence[Mapping[str, Any]]) -> str:
    """Format a table of the accuracy of each group, by setting."""
    names = list(found[0]["forced_right"])
    rows = ["\n" + format_head(("pitch, full scale", *names))]
    for part in found:
        place = f"{part['pitch_mm']:g} mm, {part['full_scale_kpa']:g} kPa"
        rows.append(
            format_row([place, *map(format_percent, part["forced_right"].values())])
        )
    return "\n".join(rows)


def format_percent(part: float | None) -> str:
    """Format a share; empty for None."""
    return "" if part is None else f"{part:.1%}"


if __name__ == "__main__":
    main()
