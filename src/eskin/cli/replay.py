"""`eskin replay`: a recording to detections, as live."""

from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from eskin.errors import RecordingError

if TYPE_CHECKING:
    from eskin.live import Detection
    from eskin.recording import Label, Recording


@dataclass(frozen=True)
class Command:
    """Replay a recording through the recogniser, one scan at a time, as live."""

    recording: tyro.conf.Positional[Path]
    """The recording, an .mcap file."""

    model: Path = Path("ur5")
    """The model: one that comes with eskin, or a .safetensors file that `eskin train`
    wrote."""

    threshold: float | None = None
    """Probability from which a gesture is said while the touch goes on; that of the
    model unless given."""

    robot_urdf: str | None = None
    """The robot that it was recorded on, where that does not come with eskin."""

    record: Path | None = None
    """Write the recording again with these detections in it, in place of any others."""


def run(command: Command) -> dict[str, object]:
    """Replay and return the detections."""
    from eskin.live import Recognizer
    from eskin.model import load_model
    from eskin.recording import read_recording, rewrite_recording, select_labels
    from eskin.robot import load_recorded_robot
    from eskin.skin import MountedSkin

    check(command)
    recording = read_recording(command.recording)
    model = load_model(command.model)
    mounted = MountedSkin(
        recording.skin, load_recorded_robot(recording.robot_name, command.robot_urdf)
    )
    decision = model.card.decision
    if command.threshold is not None:
        decision = replace(decision, threshold=command.threshold, thresholds={})
    recognizer = Recognizer(model, mounted, recording.calibration, decision)
    introduce(recording)
    truth = select_labels(recording.labels)
    found: list[Detection] = []
    rows: list[dict[str, object]] = []
    for scan in recording.scans():
        found += recognizer.push(scan)
        rows += tell(recording, truth, found[len(rows) :])
    found += recognizer.finish()
    rows += tell(recording, truth, found[len(rows) :])
    print(f"{len(rows)} detections")
    if command.record is not None:
        rewrite_recording(
            recording, command.record, detections=[f.record() for f in found]
        )
        print(f"written to {command.record}")
    return {"detections": rows}


def check(command: Command) -> None:
    """Refuse what cannot end well, before the work is done."""
    if command.record is not None and command.record.is_dir():
        raise RecordingError(
            f"cannot write {command.record}: it is a folder; give the path of a file"
        )
    if command.record is not None and not command.record.absolute().parent.is_dir():
        raise RecordingError(
            f"cannot write {command.record}: no folder {command.record.parent}; "
            "give a path in a folder that exists"
        )


def introduce(recording: "Recording") -> None:
    """Print what is replayed, and the heads of the columns."""
    seconds = (recording.end - recording.start) * 1e-9
    print(f"{recording.path}: {recording.count} readings in {seconds:.1f} s")
    if recording.truncated:
        print("the file is cut or damaged: replaying up to its last whole part")
    print(f"{'time':>8}  {'detection':16} {'sure':>4}  {'label':16} where")


def tell(
    recording: "Recording",
    truth: "tuple[Label, ...]",
    detections: "list[Detection]",
) -> list[dict[str, object]]:
    """Print detections beside their labels, and return them as plain values."""
    rows = []
    for found in detections:
        seconds = (found.stamp - recording.start) * 1e-9
        label = label_of(found, truth) if truth else None
        print(
            f"{seconds:7.2f}s  {found.gesture:16} {found.confidence:4.0%}  "
            f"{label or '-':16} {found.patch} on {found.link}"
        )
        plain = {"seconds": seconds, "label": label, "touch": found.touch}
        rows.append(plain | asdict(found.record()))
    return rows


def label_of(found: "Detection", truth: "tuple[Label, ...]") -> str:
    """The gesture whose labels share most time with the touch, else `none`."""
    shared: dict[str, int] = {}
    for label in truth:
        # A touch seen in one reading only has an instant, which counts as 1 ns.
        time = min(label.end, found.end + 1) - max(label.start, found.onset)
        if time > 0:
            shared[label.gesture] = shared.get(label.gesture, 0) + time
    return max(shared, key=lambda gesture: shared[gesture], default="none")
