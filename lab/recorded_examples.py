"""This module writes a recording for each repetition of a gesture, to learn from few.

The repetitions are those of public sets, or of simulated people.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal

from eskin.learn.dataset import Dataset, prepare
from eskin.learn.ground_truth import Clip, read_clips
from eskin.recording import (
    NONE,
    Label,
    Metadata,
    Recording,
    RecordingWriter,
    find_recordings,
    read_recording,
    write_all,
)
from eskin.skin import Skin, build_grid_skin
from eskin.touch import Calibration, Scan
from eskin.units import NS_PER_S
from lab.public_sets import SETS, TOUCHED, PublicSet, Trial, read_trials
from lab.simulated_sets import made_set
from lab.transfer import FINEST, build_scans

RATE = 50.0
"""Rate to which the repetitions of public sets are resampled [Hz]."""

SIMULATED_CLIPS, SIMULATED_PEOPLE, SIMULATED_SEED = 600, 4, 29
"""Number of clips and of simulated people, and the seed of their set."""

Source = Literal["socialtouch", "shearsense", "simulated"]


@dataclass(frozen=True, eq=False)
class RecordedExamples:
    """Holds a data set of one recording a repetition, with what each of them is."""

    dataset: Dataset
    """Data set of all repetitions."""
    person: tuple[str, ...]
    """Person of each recording."""
    group: tuple[str, ...]
    """Group of the gesture of each recording."""
    source: tuple[str, ...]
    """Longer recording of which each is a part; repetitions of one belong together."""

    @property
    def vocabulary(self) -> tuple[str, ...]:
        """Return the classes: `none`, and the groups."""
        return (NONE, *sorted(set(self.group)))

    def find(self, person: str, group: str) -> dict[str, list[int]]:
        """Return the recordings of a person and group, by their source."""
        pairs = zip(self.person, self.group, strict=True)
        found: dict[str, list[int]] = {}
        for n, pair in enumerate(pairs):
            if pair == (person, group):
                found.setdefault(self.source[n], []).append(n)
        return found


@dataclass(frozen=True)
class Example:
    """An example is the recording of a repetition."""

    path: Path
    """Path of the recording."""
    person: str
    """Person."""
    group: str
    """Group of the gesture."""
    source: str
    """Longer recording of which it is a part."""


Found = tuple[Example, Callable[[], None]]
"""Example, and a function that writes its recording."""


def build_examples(
    kind: Source, work: Path, data: Path | None, cap: int | None, workers: int
) -> RecordedExamples:
    """Write a recording for each repetition, unless it is there, and prepare all.

    Args:
        kind: set of the repetitions.
        work: folder of the recordings, and of their prepared forms.
        data: folder of a public set, as downloaded; its default where None.
        cap: greatest number of repetitions of a group and person; all where None.
        workers: number of processes.
    """
    work.mkdir(parents=True, exist_ok=True)
    if kind == "simulated":
        found = find_simulated(work, workers)
    else:
        name = "socialtouch-groups" if kind == "socialtouch" else kind
        found = find_public(SETS[name], data, work)
    counts: dict[tuple[str, str], int] = {}
    kept = []
    for example, write in found:
        key = example.person, example.group
        counts[key] = counts.get(key, 0) + 1
        if cap is None or counts[key] <= cap:
            if not example.path.exists():
                write()
            kept.append(example)
    paths = [example.path for example in kept]
    return RecordedExamples(
        prepare(paths, pack=work / "pack", workers=workers),
        tuple(example.person for example in kept),
        tuple(example.group for example in kept),
        tuple(example.source for example in kept),
    )


def find_public(public: PublicSet, data: Path | None, work: Path) -> Iterator[Found]:
    """Yield the trials of a public set, without those of no touch."""
    pitch = public.pitch_mm / 1000
    skin = build_grid_skin(public.rows, public.columns, pitch, calibrated=True)
    calibration = Calibration.uniform(skin.count, FINEST, public.full_scale_kpa)
    names = {x: group.name for group in public.groups for x in group.gestures}
    counts: dict[tuple[str, str], int] = {}
    for trial in read_trials(public, data or public.folder):
        group = names[trial.gesture].replace(" ", "_")
        if group == NONE:
            continue
        key = trial.subject, group
        counts[key] = counts.get(key, 0) + 1
        path = work / f"{trial.subject}-{group}-{counts[key]:03d}.mcap"
        example = Example(path, trial.subject, group, trial.source or path.name)
        yield example, partial(write_trial, path, trial, group, skin, calibration)


def write_trial(
    path: Path, trial: Trial, group: str, skin: Skin, calibration: Calibration
) -> None:
    """Write a trial with its label, from its first to its last touched scan."""
    scans = list(build_scans(trial, RATE))
    touched = [s.stamp for s in scans if s.counts.max() >= TOUCHED * FINEST]
    labels = []
    if touched:
        end = touched[-1] + round(NS_PER_S / RATE)
        labels = [Label(touched[0], end, group)]
    metadata = Metadata("few examples", trial.subject, trial.subject)
    with RecordingWriter(path, "table", skin, calibration, metadata) as writer:
        write_all(writer, scans, labels)


def find_simulated(work: Path, workers: int) -> Iterator[Found]:
    """Yield the clips of simulated people, without those of no gesture."""
    folder = made_set(
        work,
        "test-s",
        clips=SIMULATED_CLIPS,
        people=SIMULATED_PEOPLE,
        seed=SIMULATED_SEED,
        workers=workers,
    )
    for path in find_recordings([folder]):
        recording = read_recording(path)
        person, scans = recording.metadata.subject, list(recording.scans())
        for number, clip in enumerate(read_clips(path)):
            if clip.gesture == NONE:
                continue
            target = work / f"{path.stem}-{clip.gesture}-{number:03d}.mcap"
            example = Example(target, person, clip.gesture, target.name)
            yield example, partial(write_clip, target, recording, scans, clip)


def write_clip(
    path: Path, recording: Recording, scans: Sequence[Scan], clip: Clip
) -> None:
    """Write a clip with its label, after the rest at the start of its recording.

    There are no scans between clips, and a device is tared at rest. The rest is moved
    in time, and to the pose of the clip, so that it ends where the clip begins.
    """
    first = read_clips(recording.path)[0].start
    inside = [s for s in scans if clip.start <= s.stamp < clip.end]
    rest = [s for s in scans if s.stamp < first]
    period = rest[1].stamp - rest[0].stamp
    moved = clip.start - period - rest[-1].stamp
    rest = [replace(s, stamp=s.stamp + moved, q=inside[0].q) for s in rest]
    labels = [
        label
        for label in recording.labels
        if label.source == "true" and clip.start <= label.start < clip.end
    ]
    with RecordingWriter(
        path,
        recording.robot_name,
        recording.skin,
        recording.calibration,
        Metadata("few examples", recording.metadata.subject),
        recording.joint_names,
        recording.urdf,
    ) as writer:
        write_all(writer, rest + inside, labels)
