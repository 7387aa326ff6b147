"""`eskin view` plays a recording in the browser, where its labels are corrected."""

from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Annotated

import tyro

from eskin.cli.checks import POSITIVE_OR_INF, load_overrides

if TYPE_CHECKING:
    from eskin.labelling.timeline import Timeline

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


def run(command: ViewCommand) -> dict[str, object]:
    """Serve the page; return the number of labels and whether they are saved."""
    from eskin.live import Recognizer, load_model
    from eskin.page.process import describe_link, format_link, free_port, make_token
    from eskin.recording import read_recording
    from eskin.recording.label_check import describe_outside
    from eskin.skin import MountedSkin

    port = free_port(command.port)
    # Labels are saved in the recording as it is, on the robot that was recorded.
    recording = read_recording(command.recording)
    played = recording
    overrides = load_overrides(None, command.robot_urdf)
    if overrides.robot is not None:
        played = recording.with_robot(overrides.robot)
    robot = played.load_robot()
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
    from eskin.labelling.editing import LabelEditor, load_replayed
    from eskin.labelling.timeline import GESTURES, Timeline
    from eskin.page.server import open_server

    replayed = load_replayed(played, mounted, config)
    vocabulary = [*(found.gesture for found in detections), *GESTURES]
    editor = LabelEditor(recording, vocabulary)
    if outside := recording.label_set.outside:
        # The page shows the time of the recording, in which they could not be removed.
        editor.remove(*outside)
        print(
            f"{describe_outside(recording.label_set)}; saving leaves them "
            "out, and undo brings them back"
        )
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
