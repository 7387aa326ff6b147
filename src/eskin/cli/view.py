"""`eskin view`: a recording in the browser, with a timeline to label on."""

from dataclasses import dataclass
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING

import tyro

if TYPE_CHECKING:
    from eskin.viewer.timeline.timeline import Timeline

TICK = 0.04
"""Between two pictures [s]."""


@dataclass(frozen=True)
class Command:
    """Show a recording in the browser: play it, set and mend labels, and save them.

    The recording as it was is kept beside it. Ends with --seconds or Ctrl-C.
    """

    recording: tyro.conf.Positional[Path]
    """The recording, an .mcap file."""

    robot_urdf: str | None = None
    """The robot that it was recorded on, where that does not come with eskin."""

    port: int = 8080
    """Of the page on this computer; 0 for any free one."""

    seconds: float | None = None
    """When to stop."""


def run(command: Command) -> dict[str, object]:
    """Serve until it is over; what became of the labels."""
    from eskin.page.port import free_port
    from eskin.page.server import open_server
    from eskin.recording import read_recording
    from eskin.robot import load_recorded_robot
    from eskin.skin import MountedSkin
    from eskin.viewer.timeline import Editing, read_take
    from eskin.viewer.timeline.timeline import Timeline

    port = free_port(command.port)
    recording = read_recording(command.recording)
    mounted = MountedSkin(
        recording.skin, load_recorded_robot(recording.robot_name, command.robot_urdf)
    )
    take, editing = read_take(recording), Editing(recording)
    server = open_server(port)
    try:
        timeline = Timeline(server, mounted, take, editing)
        print(f"see http://127.0.0.1:{port}; Ctrl-C ends it", flush=True)
        play(timeline, command.seconds)
    finally:
        server.stop()
    return {"labels": len(editing.labels), "saved": not editing.changed}


def play(timeline: "Timeline", seconds: float | None) -> None:
    """Let time pass until it is over or somebody stops it."""
    begun = last = monotonic()
    try:
        while seconds is None or last - begun < seconds:
            sleep(TICK)
            now = monotonic()
            timeline.tick(now - last)
            last = now
    except KeyboardInterrupt:
        print("stopped")
