"""`eskin label`: the paper's automatic labelling."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from eskin.cli.checks import check_writable
from eskin.errors import RecordingError

if TYPE_CHECKING:
    from eskin.recording import AutoLabelResult, Recording


@dataclass(frozen=True)
class Command:
    """Label recordings automatically, where roughly known gestures press hard enough.

    The recordings get labels of source `auto` in place of earlier ones of that source;
    true labels stay as they are.
    """

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings, or folders of them."""

    threshold: float | None = None
    """Largest pressure from which on the skin is touched [kPa]; left out: the value
    that parts touched from untouched best, in each recording (Otsu)."""

    min_window: float = 0.5
    """Touches closer than this are one, so that a double-pat is not split [s]."""

    ranges: Path | None = None
    """YAML list of {start_s, end_s, gesture}: where gestures were roughly made, in
    seconds since the first reading of the one recording given. Left out: ranges in the
    recording, or else its true labels, widened by 1 s and joined by gesture."""

    out: Path | None = None
    """Folder for labelled copies; left out: the recordings themselves are replaced."""


def run(command: Command) -> dict[str, object]:
    """Label and return labels and agreement."""
    from eskin.recording import (
        LabelAgreement,
        find_recordings,
        read_recording,
        sort_labels,
    )

    check(command)
    paths = find_recordings(command.recordings)
    recordings = [read_recording(path) for path in paths]
    if command.ranges is not None and len(paths) > 1:
        raise RecordingError(
            f"--ranges {command.ranges} belongs to one recording, got {len(paths)}; "
            "label one at a time"
        )
    targets = [target_of(command, recording) for recording in recordings]
    check_targets(command, recordings, targets)
    labellings = [label_one(command, recording) for recording in recordings]
    agreement = LabelAgreement()
    for recording, labelling in zip(recordings, labellings, strict=True):
        truth = sort_labels(recording.labels, "true")
        if truth:
            agreement.add(truth, labelling.found, labelling.stamps)
    write(command, recordings, labellings, targets)
    summary = agreement.summary() if agreement.instants else None
    count = sum(len(labelling.found) for labelling in labellings)
    print(f"{count} labels in {len(paths)} recordings")
    for name, value in (summary or {}).items():
        print(f"  {name:18} {value:.3f}" if value is not None else f"  {name:18} -")
    return {"labels": count, "agreement": summary}


def check(command: Command) -> None:
    """Refuse options that mean nothing."""
    if not command.recordings:
        raise RecordingError("no recording given; give .mcap files or folders of them")
    for name in ("threshold", "min_window"):
        value = getattr(command, name)
        if value is not None and not 0 <= value < float("inf"):
            option = name.replace("_", "-")
            raise RecordingError(f"--{option} is {value}; allowed is 0 or more")


def label_one(command: Command, recording: "Recording") -> "AutoLabelResult":
    """Find the labels of one recording."""
    from eskin.recording import AutoLabelConfig, label_recording, load_ranges

    config = AutoLabelConfig(command.threshold, min_window=command.min_window)
    ranges = None
    if command.ranges is not None:
        ranges = load_ranges(command.ranges, recording.start)
    return label_recording(recording, ranges, config)


def target_of(command: Command, recording: "Recording") -> Path:
    """Where a recording goes with its labels."""
    if command.out is None:
        return recording.path
    return command.out / recording.path.name


def check_targets(
    command: Command, recordings: "list[Recording]", targets: list[Path]
) -> None:
    """Refuse all recordings where one cannot be written."""
    from eskin.recording.writer import check_not_overwritten

    if len(set(targets)) < len(targets):
        raise RecordingError(
            f"two recordings have one name and cannot both go to {command.out}; "
            "label them in two calls"
        )
    for recording, target in zip(recordings, targets, strict=True):
        check_not_overwritten(recording, target)
        check_writable(target)


def write(
    command: Command,
    recordings: "list[Recording]",
    labellings: "list[AutoLabelResult]",
    targets: list[Path],
) -> None:
    """Write all recordings with their new labels."""
    from eskin.recording import rewrite_recording

    if command.out is not None:
        command.out.mkdir(parents=True, exist_ok=True)
    for recording, labelling, target in zip(
        recordings, labellings, targets, strict=True
    ):
        kept = [label for label in recording.labels if label.source != "auto"]
        if command.ranges is not None:
            kept = [label for label in kept if label.source != "range"]
            kept += labelling.ranges
        rewrite_recording(recording, target, [*kept, *labelling.found])
