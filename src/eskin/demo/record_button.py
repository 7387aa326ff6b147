"""A recorder that is started and stopped while the stream goes on."""

import time
from pathlib import Path
from threading import Lock
from typing import final

from eskin.drivers import Event
from eskin.live import Detection
from eskin.recording import Metadata
from eskin.stream import Context, Heard, Listener, Recorder
from eskin.stream.inbox import Drop
from eskin.touch import Scan


@final
class RecordButton(Listener):
    """Records from `press` to `lift`, each time into another file."""

    name = "record button"
    hears = (Scan, Detection, Event)
    size = 2000
    drop: Drop = "newest"

    def __init__(self, folder: Path, metadata: Metadata) -> None:
        """Record nothing yet.

        Args:
            folder: that recordings go to.
            metadata: of all of them.
        """
        self.folder = folder
        self.metadata = metadata
        self.recorder: Recorder | None = None
        self.lock = Lock()

    def start(self, context: Context) -> None:
        """Remember the stream."""
        self.context = context

    def press(self) -> None:
        """Begin a recording; one that goes on goes on.

        Raises:
            RecordingError: it cannot be written.
        """
        with self.lock:
            if self.recorder is None:
                name = time.strftime("touches-%Y%m%d-%H%M%S.mcap")
                recorder = Recorder(self.folder / name, self.metadata)
                recorder.start(self.context)
                self.recorder = recorder

    def lift(self) -> None:
        """Finish the recording, if there is one."""
        with self.lock:
            recorder, self.recorder = self.recorder, None
            if recorder is not None:
                recorder.close()

    def hear(self, item: Heard) -> None:
        """Write it while recording."""
        with self.lock:
            if self.recorder is not None:
                self.recorder.hear(item)

    def close(self) -> None:
        """Finish the recording, if there is one."""
        self.lift()
