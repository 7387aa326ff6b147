"""`eskin label` labels the touches of recordings by their pressure."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from eskin.cli.checks import NOT_NEGATIVE, check_folder
from eskin.errors import RecordingError
from eskin.progress import track_progress

if TYPE_CHECKING:
    from eskin.labelling.autolabel import AutoLabelResult
    from eskin.recording import Recording


@dataclass(frozen=True)
class LabelCommand:
    """Label recordings automatically where the pressure passes a threshold.

    Rough ranges say which gesture is made where. The new labels have the source `auto`
    and replace previous ones of that source; true labels stay as they are.
    """

    recordings: tyro.conf.Positional[tuple[Path, ...]]
    """Recordings, or folders of them."""

    threshold: Annotated[float | None, NOT_NEGATIVE] = None
    """Peak pressure from which the skin counts as touched [kPa]. By default it is the
    value that separates touched from untouched best in each recording (Otsu)."""

    min_window: Annotated[float, NOT_NEGATIVE] = 0.5
    """Touches closer than this are joined, so that a double-pat is not split [s]."""

    ranges: Path | None = None
    """YAML list of {start_s, end_s, gesture}: the rough ranges of the gestures, in
    seconds since the first reading of the one recording given. By default these are the
    ranges in the recording, or else its true labels, widened by 1 s and joined by
    gesture."""

    out: Path | None = None
    """Folder for labelled copies, each of them new. By default the recordings
    themselves are replaced."""


def run(command: LabelCommand) -> dict[str, object]:
    """Label the recordings; return the number of labels and their agreement."""
    from eskin.labelling.autolabel import LabelAgreement
    from eskin.recording import find_recordings, read_recording, sort_labels

    if not command.recordings:
        raise RecordingError("no recording given; give .mcap files or folders of them")
    paths = find_recordings(command.recordings)
    recordings = [read_recording(path) for path in paths]
    if command.ranges is not None and len(paths) > 1:
        raise RecordingError(
            f"--ranges {command.ranges} belongs to one recording, got {len(paths)}; "
            "label one at a time"
        )
    targets = [
        path if command.out is None else command.out / path.name for path in paths
    ]
    check_targets(command, recordings, targets)
    results = []
    for recording in track_progress(recordings, "recordings labelled", len(paths)):
        results.append(find_labels(command, recording))
    agreement = LabelAgreement()
    for recording, result in zip(recordings, results, strict=True):
        truth = sort_labels(recording.labels, "true")
        if truth:
            agreement.add_recording(truth, result.found, result.stamps)
    write_labels(command, recordings, results, targets)
    summary = agreement.summary() if agreement.instants else None
    count = sum(len(result.found) for result in results)
    print(
        f"{count} label{'s' * (count != 1)} in {len(paths)} "
        f"recording{'s' * (len(paths) != 1)}"
    )
    for name, value in (summary or {}).items():
        print(f"  {name:18} {value:.3f}" if value is not None else f"  {name:18} -")
    return {"labels": count, "agreement": summary}


def find_labels(command: LabelCommand, recording: "Recording") -> "AutoLabelResult":
    """Find the labels of one recording."""
    from eskin.labelling.autolabel import AutoLabelConfig, label_recording
    from eskin.recording import load_ranges

    config = AutoLabelConfig(command.threshold, min_window=command.min_window)
    ranges = None
    if command.ranges is not None:
        ranges = load_ranges(command.ranges, recording.start)
    return label_recording(recording, ranges, config, command.ranges)


def check_targets(
    command: LabelCommand, recordings: "list[Recording]", targets: list[Path]
) -> None:
    """Raise if one of the labelled recordings cannot be written."""
    from eskin.recording.writer import check_copy

    if len(set(targets)) < len(targets):
        raise RecordingError(
            f"two recordings have one name and cannot both go to {command.out}; "
            "label them in two calls"
        )
    for recording, target in zip(recordings, targets, strict=True):
        check_copy(recording, target)
        check_folder(target.absolute().parent)


def write_labels(
    command: LabelCommand,
    recordings: "list[Recording]",
    results: "list[AutoLabelResult]",
    targets: list[Path],
) -> None:
    """Write all recordings with their new labels."""
    from eskin.recording import rewrite_recording

    if command.out is not None:
        command.out.mkdir(parents=True, exist_ok=True)
    for recording, result, target in zip(recordings, results, targets, strict=True):
        kept = [label for label in recording.labels if label.source != "auto"]
        if command.ranges is not None:
            kept = [label for label in kept if label.source != "range"]
            kept += result.ranges
        rewrite_recording(recording, target, [*kept, *result.found])
