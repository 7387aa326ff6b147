"""Weights on people and a sensor that they never learned from, zero-shot.

    python -m benchmarks.transfer
    python -m benchmarks.transfer --model FILE --json FILE
    python -m benchmarks.transfer --sweep

Every repetition of a public set is played to the recogniser as a live device would give
it: resampled, between rest before and after, with the pitch and the full scale that the
set does not state. Nothing is trained. There are two kinds of answer:

- forced choice, the headline: the likeliest class of the touch of largest impulse, 0.1
  s after its last contact, from the 2 s before; `none` where nothing is felt. Beside it
  the same from the mean log-probability of 2 s windows every 0.5 s.
- live: what the recogniser says by itself, of whichever touch.

A set is added by a function that reads its trials and one entry of `SETS`.
"""

import itertools
import json
import math
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from jaxtyping import Float

from eskin import Detection, Model, Recognizer, load_model
from eskin.recording import NONE
from eskin.recording import socialtouch as social
from eskin.recording.conversion import find_files
from eskin.robot import load_robot
from eskin.skin import MountedSkin, build_grid_skin
from eskin.touch import Calibration, Scan, TouchState
from eskin.units import NS_PER_S

START = 1_000 * NS_PER_S
"""Stamp of the first scan of every trial [ns]."""

REST_BEFORE = 1.5
"""Most of the time for which a taxel is tared, as in simulated recordings [s]."""

REST_AFTER = 0.6
"""Longer than a touch waits for another contact [s]."""

FINEST = 4080
"""Counts at full scale: about those of a converter of 12 bits."""

ANSWER_AFTER = round(0.1 * NS_PER_S)
"""From the last contact to the forced choice [ns]."""

WINDOW, HOP = 2.0, 0.5
"""Length of the windows that are averaged, and from one to the next [s]."""

TOUCHED = 0.1
"""Share of full scale from which a reading counts as touched in `touched_seconds`."""

HELD = 0.8
"""From which on a finger's touch is held rather than a poke [s]."""

UNKNOWN, NOTHING = "unknown", "nothing"

SWEEP_PITCHES = (4.0, 6.0, 10.0)
SWEEP_SCALES = (20.0, 40.0, 100.0)


@dataclass(frozen=True)
class Group:
    """Gestures of a set that mean the same to the recogniser."""

    name: str
    """What the tables call it."""

    gestures: tuple[str, ...]
    """Names in the set."""

    truth: str | None = None
    """The class that is right; None where no class is."""

    bar: float | None = None
    """Share of forced choices that should be right; None for what is no headline."""

    longer: float = 0.0
    """Least time that a trial is touched to be counted [s]."""

    shorter: float = math.inf
    """Time that it must be shorter than [s]."""


@dataclass(frozen=True, eq=False)
class Trial:
    """One repetition of one gesture."""

    subject: str
    """Who touched."""

    gesture: str
    """Name in the set."""

    seconds: Float[np.ndarray, "reading"]
    """When its readings were taken [s], increasing."""

    share: Float[np.ndarray, "reading taxel"]
    """Share of full scale, row by row; 0 at rest."""


@dataclass(frozen=True)
class PublicSet:
    """A public set, and what its gestures mean."""

    folder: Path
    """Where it lies unless told otherwise."""

    rows: int
    """Rows of its grid."""

    columns: int
    """Columns of its grid."""

    trials: Callable[[Path], Iterator[Trial]]
    """Reads the repetitions in a folder."""

    groups: tuple[Group, ...]
    """In the order of the tables."""


@dataclass(frozen=True)
class TransferSetting:
    """What a set does not state."""

    pitch_mm: float
    """Distance of neighbouring taxels [mm]."""

    full_scale_kpa: float
    """Pressure at full scale [kPa]."""

    rate: float
    """Scans a second that are played [Hz]."""

    floor: float = 0.0
    """Share of full scale below which a signal does not tell a touch from rest."""


@dataclass(frozen=True)
class TrialAnswer:
    """What the recogniser makes of one trial."""

    subject: str
    """Who touched."""

    gesture: str
    """Name in the set."""

    forced: str
    """The forced choice."""

    averaged: str
    """The same by the mean log-probability of windows."""

    said: tuple[str, ...]
    """What was detected live, `unknown` too, but not `none`."""

    seconds: float
    """From the first to the last touched reading of the trial [s]."""

    @property
    def gestures(self) -> set[str]:
        """The gestures that were detected live."""
        return set(self.said) - {UNKNOWN}


@dataclass(frozen=True)
class Command:
    """Play a public set to weights that have not seen it."""

    dataset: tyro.conf.Positional[Literal["socialtouch"]] = "socialtouch"
    """Which set it is."""

    data: Path | None = None
    """Its folder, as downloaded; where ../shared/data has it unless given."""

    model: Path = Path("ur5")
    """One that comes with eskin, or a file."""

    pitch_mm: float = 4.0
    """Distance of neighbouring taxels that is taken [mm]."""

    full_scale_kpa: float = 40.0
    """Pressure at full scale that is taken [kPa]."""

    rate: float = 50.0
    """Scans a second that are played [Hz]."""

    floor: float = 0.0
    """Share of full scale below which the array's signal does not tell a touch from
    rest, as its calibration would say."""

    headline: bool = False
    """Play only the groups that have a bar: a third of the time."""

    sweep: bool = False
    """Repeat the headline over pitches and full scales."""

    json: Path | None = None
    """Where to write all figures."""


def main() -> None:
    """Measure and print."""
    command = tyro.cli(Command)
    started = time.monotonic()
    public, model = SETS[command.dataset], load_model(command.model)
    if command.headline:
        public = replace(public, groups=headline_of(public))
    setting = TransferSetting(
        command.pitch_mm, command.full_scale_kpa, command.rate, command.floor
    )
    trials = trials_of(public, command.data or public.folder)
    answers = answer_trials(trials, public, model, setting)
    groups = {group.name: figures(answers, group, model) for group in public.groups}
    result: dict[str, Any] = {
        "dataset": command.dataset,
        "model": str(command.model),
        "setting": asdict(setting),
        "groups": groups,
        "gestures": gesture_figures(answers, public, model),
    }
    print(forced_table(groups, model))
    print(live_table(groups, model), flush=True)
    if command.sweep:
        result["sweep"] = sweep(trials, public, model, setting)
        print(sweep_table(result["sweep"]))
    if command.json is not None:
        command.json.write_text(json.dumps(result, indent=1) + "\n")
    print(f"\n{time.monotonic() - started:.0f} s")


def headline_of(public: PublicSet) -> tuple[Group, ...]:
    """The groups that have a bar."""
    return tuple(group for group in public.groups if group.bar is not None)


def trials_of(public: PublicSet, folder: Path) -> list[Trial]:
    """The trials in a folder that are of one of the groups."""
    wanted = {gesture for group in public.groups for gesture in group.gestures}
    return [trial for trial in public.trials(folder) if trial.gesture in wanted]


def socialtouch_trials(folder: Path) -> Iterator[Trial]:
    """Repetitions of the SocialTouch set."""
    for path in find_files(folder, "touch_*", social.SUFFIXES):
        for found in social.read_repetitions(path):
            share = found.counts / social.FULL_SCALE
            yield Trial(f"P{found.person}", found.gesture, found.seconds, share)


def answer_trials(
    trials: Iterable[Trial], public: PublicSet, model: Model, setting: TransferSetting
) -> list[TrialAnswer]:
    """Play every trial to a fresh recogniser."""
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
    """Play one trial."""
    touches = TouchTraces(recognizer)
    for scan in scans_of(trial, rate):
        touches.push(scan)
    touches.finish()
    said = {detection.gesture for detection in touches.detections} - {NONE}
    touch = touches.largest()
    seconds = touched_seconds(trial)
    found = TrialAnswer(
        trial.subject, trial.gesture, NONE, NONE, tuple(sorted(said)), seconds
    )
    if touch is None:
        return found
    names = recognizer.model.card.vocabulary
    return replace(
        found,
        forced=names[touch.forced().argmax()],
        averaged=names[touch.averaged().argmax()],
    )


def touched_seconds(trial: Trial) -> float:
    """From the first to the last reading of a trial that is well above rest [s]."""
    touched = trial.seconds[trial.share.max(axis=1) >= TOUCHED]
    return float(np.ptp(touched)) if len(touched) else 0.0


def scans_of(trial: Trial, rate: float) -> Iterator[Scan]:
    """A trial between rest, as a live device would give it.

    Between the readings, and from rest to the first and from the last to rest, what
    was felt is interpolated in time.
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
    """The probabilities of one touch at each reading while it is open."""

    onset: int
    """Stamp of its first contact [ns]."""

    last: int
    """Stamp of its last contact so far [ns]."""

    stamps: list[int]
    """Of its readings [ns]."""

    probabilities: list[Float[np.ndarray, "class"]]
    """At each of them, from the 2 s before."""

    impulse: float = 0.0
    """Its force integrated over time [N s]."""

    @property
    def end(self) -> int:
        """The reading at which the forced choice is taken; the last if none is late."""
        due = np.searchsorted(self.stamps, self.last + ANSWER_AFTER)
        return min(int(due), len(self.stamps) - 1)

    def forced(self) -> Float[np.ndarray, "class"]:
        """The probabilities just after its last contact."""
        return self.probabilities[self.end]

    def averaged(self) -> Float[np.ndarray, "class"]:
        """The mean log-probability of windows, the last one that of `forced`."""
        seconds = (self.stamps[self.end] - self.onset) / NS_PER_S
        times = self.onset + np.arange(WINDOW, seconds, HOP) * NS_PER_S
        rows = np.unique([*np.searchsorted(self.stamps, times), self.end])
        return np.log([self.probabilities[row] + 1e-12 for row in rows]).mean(axis=0)


class TouchTraces:
    """Keeps what a recogniser makes of one trial."""

    def __init__(self, recognizer: Recognizer) -> None:
        """Start before the first scan."""
        self.recognizer = recognizer
        self.traces: dict[int, TouchTrace] = {}
        self.merged: set[int] = set()
        self.detections: list[Detection] = []

    def push(self, scan: Scan) -> None:
        """Take the next scan."""
        self.detections += self.recognizer.push(scan)
        state = self.recognizer.state
        assert state is not None
        for touch in state.open:
            trace = self.traces.setdefault(touch.id, TouchTrace(touch.onset, 0, [], []))
            trace.last = touch.last
            trace.stamps.append(scan.stamp)
            trace.probabilities.append(self.recognizer.probabilities[touch.id])
        if state.closed:
            self.weigh(state)

    def finish(self) -> None:
        """Close what is still open."""
        if self.recognizer.state is not None:
            self.weigh(self.recognizer.state)
        self.detections += self.recognizer.finish()

    def weigh(self, state: TouchState) -> None:
        """Keep the impulses of all touches, and which became part of another."""
        for row in state.rows:
            if row.id in self.traces:
                self.traces[row.id].impulse = row.impulse
            if row.merged_into:
                self.merged.add(row.id)

    def largest(self) -> TouchTrace | None:
        """The touch of largest impulse; None where nothing was felt."""
        whole = [self.traces[key] for key in self.traces.keys() - self.merged]
        return max(whole, key=lambda trace: trace.impulse, default=None)


def members(answers: Iterable[TrialAnswer], group: Group) -> list[TrialAnswer]:
    """The answers that count for a group."""
    return [
        answer
        for answer in answers
        if answer.gesture in group.gestures
        and group.longer <= answer.seconds < group.shorter
    ]


def figures(
    answers: Sequence[TrialAnswer], group: Group, model: Model
) -> dict[str, object]:
    """All figures of a group, and of each person in it."""
    inside = members(answers, group)
    people = sorted({answer.subject for answer in inside})
    return {
        "gestures": group.gestures,
        "truth": group.truth,
        "bar": group.bar,
        **shares(inside, group.truth, model),
        "people": {
            person: shares(
                [a for a in inside if a.subject == person], group.truth, model
            )
            for person in people
        },
    }


def gesture_figures(
    answers: Sequence[TrialAnswer], public: PublicSet, model: Model
) -> dict[str, dict[str, object]]:
    """The figures of every gesture of the set on its own, however long it lasts."""
    return {
        gesture: shares(
            [a for a in answers if a.gesture == gesture], group.truth, model
        )
        for group in public.groups
        for gesture in group.gestures
    }


def shares(
    answers: Sequence[TrialAnswer], truth: str | None, model: Model
) -> dict[str, object]:
    """What share of trials was answered how; of what is right only where that is known.

    Live, a trial is right where the true gesture was said at least once (where truth is
    `none`: no gesture), and wrong where another one was: it can be both.
    """
    names = model.card.vocabulary
    live = (*(name for name in names if name != NONE), UNKNOWN)
    found: dict[str, object] = {
        "n": len(answers),
        "forced": {n: share(a.forced == n for a in answers) for n in names},
        "averaged": {n: share(a.averaged == n for a in answers) for n in names},
        "live": {n: share(n in a.said for a in answers) for n in live}
        | {NOTHING: share(not a.gestures for a in answers)},
    }
    if truth is not None:
        found["forced_right"] = share(a.forced == truth for a in answers)
        found["averaged_right"] = share(a.averaged == truth for a in answers)
        found["live_right"] = share(
            truth in a.said if truth != NONE else not a.gestures for a in answers
        )
        found["live_wrong"] = share(bool(a.gestures - {truth}) for a in answers)
    return found


def share(found: Iterable[bool]) -> float | None:
    """Which share is true; None of none."""
    values = list(found)
    return sum(values) / len(values) if values else None


def forced_table(found: Mapping[str, Mapping[str, Any]], model: Model) -> str:
    """One row a group, and a person in it: shares of the forced choices."""
    names = model.card.vocabulary
    heads = ("forced choice", "truth", "n", *names, "right", "bar", "averaged right")
    rows = [head_of(heads)]
    for name, truth, bar, part in rows_of(found):
        cells = [name, truth, str(part["n"])]
        cells += [percent(part["forced"][n]) for n in names]
        cells += [percent(part.get("forced_right")), percent(bar)]
        rows.append(row_of([*cells, percent(part.get("averaged_right"))]))
    return "\n".join(rows)


def live_table(found: Mapping[str, Mapping[str, Any]], model: Model) -> str:
    """One row a group, and a person in it: in which share of trials what is said."""
    names = (*(n for n in model.card.vocabulary if n != NONE), UNKNOWN, NOTHING)
    rows = [head_of(("said live", "truth", "n", *names, "right", "wrong"))]
    for name, truth, _, part in rows_of(found):
        cells = [name, truth, str(part["n"])]
        cells += [percent(part["live"][n]) for n in names]
        cells += [percent(part.get(key)) for key in ("live_right", "live_wrong")]
        rows.append(row_of(cells))
    return "\n".join(rows)


def rows_of(
    found: Mapping[str, Mapping[str, Any]],
) -> Iterator[tuple[str, str, float | None, Mapping[str, Any]]]:
    """Name, truth, bar and figures of each group, followed by those of its people."""
    for name, group in found.items():
        yield name, group["truth"] or "", group["bar"], group
        for person, part in group["people"].items():
            yield f"- {person}", "", None, part


def sweep(
    trials: Sequence[Trial], public: PublicSet, model: Model, usual: TransferSetting
) -> list[dict[str, Any]]:
    """The share of right forced choices of each headline group, setting by setting."""
    groups = headline_of(public)
    wanted = {gesture for group in groups for gesture in group.gestures}
    chosen = [trial for trial in trials if trial.gesture in wanted]
    found = []
    for pitch, scale in itertools.product(SWEEP_PITCHES, SWEEP_SCALES):
        setting = replace(usual, pitch_mm=pitch, full_scale_kpa=scale)
        answers = answer_trials(chosen, public, model, setting)
        right = {g.name: figures(answers, g, model)["forced_right"] for g in groups}
        found.append(asdict(setting) | {"forced_right": right})
    return found


def sweep_table(found: Sequence[Mapping[str, Any]]) -> str:
    """One row a setting: the share that is right of each headline group."""
    names = list(found[0]["forced_right"])
    rows = [head_of(("pitch, full scale", *names))]
    for part in found:
        place = f"{part['pitch_mm']:g} mm, {part['full_scale_kpa']:g} kPa"
        rows.append(row_of([place, *map(percent, part["forced_right"].values())]))
    return "\n".join(rows)


def head_of(names: Sequence[str]) -> str:
    """Head of a table."""
    return f"\n{row_of(names)}\n{'|---' * len(names)}|"


def row_of(cells: Sequence[str]) -> str:
    """Row of a table."""
    return f"| {' | '.join(cells)} |"


def percent(part: float | None) -> str:
    """A share as text; empty where there is none."""
    return "" if part is None else f"{part:.1%}"


def groups_of_socialtouch() -> tuple[Group, ...]:
    """What the 32 gestures of SocialTouch mean, by their numbers."""

    def named(*numbers: int) -> tuple[str, ...]:
        return tuple(social.GESTURES[number] for number in numbers)

    fingers = named(2, 3, 4, 5)
    return (
        Group("poke", named(6, 7), "poke", bar=0.60),
        Group("stroke", named(18, 19, 20, 27, 28), "stroke", bar=0.85),
        Group("resting hand or arm", named(0, 1, 25, 26), NONE, bar=0.95),
        Group(f"finger held, {HELD} s or longer", fingers, NONE, longer=HELD),
        Group("finger touch, shorter", fingers, shorter=HELD),
        Group("pat", named(8, 9), "double_pat"),
        Group("tap", named(12, 13, 29)),
        Group("slap, hit", named(14, 15, 16, 17)),
        Group("pinch", named(10, 11)),
        Group("caress", named(21, 30)),
        Group("tickle", named(22, 23, 24)),
        Group("hug", named(31)),
    )


SETS = {
    "socialtouch": PublicSet(
        folder=Path("../shared/data/socialtouch"),
        rows=social.ROWS,
        columns=social.COLUMNS,
        trials=socialtouch_trials,
        groups=groups_of_socialtouch(),
    )
}


if __name__ == "__main__":
    main()
