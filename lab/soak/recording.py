"""Record the idle skin and print each stamp, until the process is killed.

python -m lab.soak.recording FILE
"""

import sys

from eskin.recording import Metadata
from eskin.stream import Context, Listener, Message, Recorder, Stream
from eskin.touch import Scan
from lab.soak.scans import idle_source

RATE = 50.0


class StampPrinter(Listener):
    """Prints the stamp of every scan."""

    name = "stamps"
    message_types = (Scan,)
    size = 1000
    drop = "never"

    def start(self, context: Context) -> None:
        """Do nothing."""

    def on_message(self, item: Message) -> None:
        """Print the stamp of a scan without delay."""
        if isinstance(item, Scan):
            print(item.stamp, flush=True)

    def close(self) -> None:
        """Do nothing."""


def main() -> None:
    """Record the idle ur5 skin."""
    listeners = (Recorder(sys.argv[1], Metadata("soak")), StampPrinter())
    with Stream(idle_source(RATE), listeners) as stream:
        stream.wait()


if __name__ == "__main__":
    main()
