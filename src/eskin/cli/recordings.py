"""`eskin label`, `replay` and `view` work on recordings."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Annotated

import tyro

from eskin.cli.checks import (
    NOT_NEGATIVE,
    POSITIVE_OR_INF,
    check_folder,
    load_overrides,
)
from eskin.errors import RecordingError
from eskin.progress import track_progress
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.live import Detection
    from eskin.page.timeline import Timeline
    from eskin.recording import (
        AutoLabelResult,
        Label,
        Recording,
    )


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


def run_label(command: LabelCommand) -> dict[str, object]:
    """Label the recordings; return the number of labels and their agreement."""
    from eskin.recording import (
        LabelAgreement,
        find_recordings,
        read_recording,
        sort_labels,
    )

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
            agreement.add(truth, result.found, result.stamps)
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
    from eskin.recording import AutoLabelConfig, label_recording, load_ranges

    config = AutoLabelConfig(command.threshold, min_window=command.min_window)
    ranges = None
    if command.ranges is not None:
        ranges = load_ranges(command.ranges, recording.start)
    return label_recording(recording, ranges, config)


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


@dataclass(frozen=True)
class ReplayCommand:
    """Replay a recording through the recogniser, one scan at a time, as live."""

    recording: tyro.conf.Positional[Path]
    """The recording, an .mcap file."""

    model: Path = Path("ur5")
    """Name of weights that come with eskin, or a .safetensors file that `eskin train`
    wrote."""

    threshold: Annotated[float | None, NOT_NEGATIVE] = None
    """Confidence from which a gesture is reported while the touch goes on. By default
    it is that of the model; above 1 a gesture waits for the end of its touch."""

    robot_urdf: str | None = None
    """Robot in place of the recorded one, as for its meshes: a URDF file or a preset's
    name."""

    calibration: Path | None = None
    """Calibration file, as eskin calibrate writes it, to use in place of the recorded
    one."""

    falling: bool = False
    """The sensor's counts become smaller when it is pressed, whatever the calibration
    says."""

    record: Path | None = None
    """Path of a copy of the recording that holds these detections in place of any
    others: a new path, or that of the recording, which is replaced."""


def run_replay(command: ReplayCommand) -> dict[str, object]:
    """Replay the recording, print and return the detections."""
    from eskin.cli.terminal import SkinPrinter
    from eskin.live import Recognizer, load_model
    from eskin.recording import read_recording, rewrite_recording, select_labels
    from eskin.skin import MountedSkin

    overrides = load_overrides(command.calibration, command.robot_urdf)
    recording = read_recording(command.recording, overrides)
    if command.record is not None:
        check_replay_copy(recording, command.record)
    if command.falling:
        calibration = replace(recording.calibration, falling=True)
        recording = replace(recording, calibration=calibration)
    model = load_model(command.model)
    mounted = MountedSkin(recording.skin, recording.load_robot())
    decision = model.card.decision
    if command.threshold is not None:
        decision = replace(decision, threshold=command.threshold, thresholds={})
    recognizer = Recognizer(model, mounted, recording.calibration, decision)
    print_header(recording)
    truth = select_labels(recording.labels)
    found: list[Detection] = []
    rows: list[dict[str, object]] = []
    printer = SkinPrinter(recording.skin)
    for scan in recording.scans():
        found += recognizer.push(scan)
        rows += report(recording, truth, found[len(rows) :])
        if recognizer.state is not None:
            printer.push(scan.stamp, recognizer.state.faults)
    found += recognizer.finish()
    rows += report(recording, truth, found[len(rows) :])
    printer.finish()
    print(f"{len(rows)} detection{'s' * (len(rows) != 1)}")
    if command.record is not None:
        rewrite_recording(
            recording, command.record, detections=[f.record() for f in found]
        )
        print(f"written to {command.record}")
    return {"detections": rows}


def check_replay_copy(recording: "Recording", copy: Path) -> None:
    """Raise if the copy of a recording that is replayed cannot be written."""
    from eskin.recording.writer import check_copy

    if copy.is_dir():
        raise RecordingError(
            f"cannot write {copy}: it is a folder; give the path of a file"
        )
    if not copy.absolute().parent.is_dir():
        raise RecordingError(
            f"cannot write {copy}: no folder {copy.parent}; give a path in a folder "
            "that exists"
        )
    check_copy(recording, copy)


def print_header(recording: "Recording") -> None:
    """Print what is replayed, and the column titles."""
    print(
        f"{recording.path}: {format_count(recording.count, 'reading')} in "
        f"{recording.seconds:.1f} s"
    )
    if recording.gaps:
        print(f"besides {recording.describe_gaps()}")
    if recording.truncated:
        print("the file is cut or damaged: replaying up to its last whole part")
    if not recording.skin.calibrated:
        print(
            "the pitch of the skin is not known: all contacts at a time are one touch"
        )
    print(f"{'time':>8}  {'detection':16} {'conf':>4}  {'label':16} where")


def report(
    recording: "Recording",
    truth: "tuple[Label, ...]",
    detections: "list[Detection]",
) -> list[dict[str, object]]:
    """Print detections beside their labels; return them as plain values."""
    from eskin.cli.terminal import describe_where

    rows = []
    for found in detections:
        seconds = (found.stamp - recording.start) * 1e-9
        label = find_label(found, truth) if truth else None
        print(
            f"{seconds:7.2f}s  {found.gesture:16} {found.confidence:4.0%}  "
            f"{label or '-':16} {describe_where(found, recording.skin)}"
        )
        plain = {"seconds": seconds, "label": label, "touch": found.touch}
        rows.append(plain | asdict(found.record()))
    return rows


def find_label(found: "Detection", truth: "tuple[Label, ...]") -> str:
    """Return the gesture whose labels share most time with a touch, else `none`."""
    shared: dict[str, int] = {}
    for label in truth:
        # A touch of one reading only has no duration, which counts as 1 ns.
        time = min(label.end, found.end + 1) - max(label.start, found.onset)
        if time > 0:
            shared[label.gesture] = shared.get(label.gesture, 0) + time
    return max(shared, key=lambda gesture: shared[gesture], default="none")


TICK_S = 0.04
"""Time between two updates of the page [s]."""


@dataclass(frozen=True)
class ViewCommand:
    """Show a recording in the browser: play it, set and correct labels, and save them.

    A copy of the original recording is kept beside it. The command ends after --seconds
    or by Ctrl-C.
    """

    recording: tyro.conf.Positional[Path]
    """The recording, an .mcap file."""

    robot_urdf: str | None = None
    """Robot in place of the recorded one, as for its meshes: a URDF file or a preset's
    name."""

    model: str | None = None
    """Weights whose detections are shown beside the labels, a name or a file; by
    default the detections in the recording are."""

    port: int = 8080
    """TCP port of the page on this computer; 0 takes any free one."""

    seconds: Annotated[float | None, POSITIVE_OR_INF] = None
    """Time after which to stop [s]."""


def run_view(command: ViewCommand) -> dict[str, object]:
    """Serve the page; return the number of labels and whether they are saved."""
    from eskin.live import Recognizer, load_model
    from eskin.page.process import describe_link, format_link, free_port, make_token
    from eskin.recording import Overrides, read_recording
    from eskin.robot import load_robot
    from eskin.skin import MountedSkin

    port = free_port(command.port)
    recording = played = read_recording(command.recording)
    if command.robot_urdf is None:
        robot = recording.load_robot()
    else:
        robot = load_robot(command.robot_urdf)
        played = read_recording(command.recording, Overrides(urdf=robot.urdf))
    if lacking := robot.describe_lacking_meshes("drawn"):
        print(lacking)
    mounted = MountedSkin(recording.skin, robot)
    detections = recording.detections
    config = None
    if command.model is not None:
        model = load_model(command.model)
        config = model.card.pipeline
        recognizer = Recognizer(model, mounted, recording.calibration)
        found = [found for scan in played.scans() for found in recognizer.push(scan)]
        found += recognizer.finish()
        detections = tuple(detection.record() for detection in found)
    # Only now: the page takes a while to import.
    from eskin.page.editing import LabelEditor, load_replayed
    from eskin.page.server import open_server
    from eskin.page.timeline import GESTURES, Timeline

    replayed = load_replayed(played, mounted, config)
    vocabulary = [*(found.gesture for found in detections), *GESTURES]
    editor = LabelEditor(recording, vocabulary)
    token = make_token()
    server = open_server(port, token)
    try:
        timeline = Timeline(server, mounted, replayed, editor, detections)
        if replayed.group > 1:
            print(f"a long recording: one reading in {replayed.group} is shown")
        print(describe_link(format_link(port, token)))
        print("Ctrl-C ends it", flush=True)
        play_timeline(timeline, command.seconds)
    finally:
        server.stop()
    return {"labels": len(editor.labels), "saved": not editor.changed}


def play_timeline(timeline: "Timeline", seconds: float | None) -> None:
    """Advance the timeline in real time until the time is over or Ctrl-C."""
    start = last = monotonic()
    try:
        while seconds is None or last - start < seconds:
            sleep(TICK_S)
            now = monotonic()
            timeline.tick(now - last)
            last = now
    except KeyboardInterrupt:
        print("stopped")
