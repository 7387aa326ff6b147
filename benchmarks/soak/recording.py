"""A process that records and says what it streams, until it is killed.

python -m benchmarks.soak.recording FILE
"""

import sys

from benchmarks.soak.scans import idle_source
from eskin.recording import Metadata
from eskin.stream import Context, Listener, Message, Recorder, Stream
from eskin.touch import Scan

RATE = 50.0


class Teller(Listener):
    """Prints the stamp of every scan."""

    name = "teller"
    message_types = (Scan,)
    size = 1000
    drop = "never"

    def start(self, context: Context) -> None:
        """Nothing is needed."""

    def on_message(self, item: Message) -> None:
        """Print one line at once."""
        if isinstance(item, Scan):
            print(item.stamp, flush=True)

    def close(self) -> None:
        """Nothing is held."""


def main() -> None:
    """Record the idle ur5 skin."""
    listeners = (Recorder(sys.argv[1], Metadata("soak")), Teller())
    with Stream(idle_source(RATE), listeners) as stream:
        stream.wait()


if __name__ == "__main__":
    main()
