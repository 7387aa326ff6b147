"""`eskin replay` recognises a recording as if it were live."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from eskin.cli.checks import NOT_NEGATIVE, load_overrides
from eskin.errors import RecordingError
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.live import Detection
    from eskin.recording import Label, Recording


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


def run(command: ReplayCommand) -> dict[str, object]:
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
            printer.print_reading(scan.stamp, recognizer.state.faults)
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
    """Print which recording is replayed, and the column titles."""
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
