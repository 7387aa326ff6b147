"""This module prints detections, events and commands as lines on the terminal."""

import sys
from collections.abc import Sequence
from typing import final

from eskin.command import ASK
from eskin.drivers import Event
from eskin.live import Detection
from eskin.skin import Skin
from eskin.stream import CommandEvent, Context, FaultReporter, Listener, Message
from eskin.stream.listener import Drop
from eskin.touch import Fault, Scan
from eskin.units import NS_PER_S, format_count

PATCH_KINDS = {"appeared", "silent", "returned", "slow", "on_rate", "late", "in_time"}
"""Kinds of events that many patches have at once, as when a cable is pulled."""
BELL = "\a"
"""Character at which a terminal makes a sound."""
LISTED = 3
"""Number of patches with such an event that are printed; the others are counted."""
TOGETHER = NS_PER_S // 2
"""Longest time between two such events that are counted together [ns]."""


def format_event(event: Event, first: int) -> str:
    """Return an event as a line, with the seconds since a first stamp [ns]."""
    seconds = (event.stamp - first) / NS_PER_S
    return f"{seconds:7.2f}s  {event.kind:12} {'':4}  {event.text}"


def describe_where(found: Detection, skin: Skin) -> str:
    """Describe where a touch was: patch and link.

    Where both have one name, as of a matrix that covers its link, row and column say
    more.
    """
    if found.patch != found.link or found.taxel is None:
        return f"{found.patch} on {found.link}"
    patch = skin.patches[int(skin.patch_index[found.taxel])]
    row = int(skin.rows[found.taxel])
    column = int(skin.columns[found.taxel])
    return f"{found.link}, {patch.describe_cell(row, column)}"


@final
class EventLines:
    """Prints events as lines, with seconds since a first stamp; stateful.

    Of patches that appear or become silent together, it prints three and counts the
    others.
    """

    def __init__(self, first: int) -> None:
        """Start without an event.

        Args:
            first: stamp from which seconds count [ns since the epoch].
        """
        self.first = first
        self.last: Event | None = None
        self.together: list[str] = []
        self.more = 0

    def print_event(self, event: Event) -> None:
        """Print an event, unless it is one of many of its kind at once."""
        is_new = self.gather(event)
        if event.patch in self.together[LISTED:]:
            # Each patch is counted once however many events it has.
            self.more += is_new
            return
        self.close()
        print(format_event(event, self.first), flush=True)

    def gather(self, event: Event) -> bool:
        """Collect patches with events of one kind at once; return whether it is new."""
        last = self.last
        self.last = event
        is_next = (
            last is not None
            and event.kind == last.kind
            and event.stamp - last.stamp <= TOGETHER
        )
        if not is_next:
            self.together = []
        is_new = event.kind in PATCH_KINDS and event.patch not in self.together
        if is_new and event.patch is not None:
            self.together.append(event.patch)
        return is_new

    def pass_time(self, stamp: int) -> None:
        """Print the number of patches that were only counted, once no more may come."""
        if self.last is not None and stamp - self.last.stamp > TOGETHER:
            self.close()

    def close(self) -> None:
        """Print the number of patches that were only counted."""
        if self.more:
            text = f"and {format_count(self.more, 'patch')} more"
            print(f"{'':8}  {'':12} {'':4}  {text}", flush=True)
        self.more = 0


@final
class SkinPrinter:
    """Prints what happens to a skin, for commands that read its scans themselves.

    Its lines are those that `TerminalPrinter` prints of a stream.
    """

    def __init__(self, skin: Skin) -> None:
        """Start before the first scan of a skin."""
        self.reporter = FaultReporter(skin)
        self.lines: EventLines | None = None

    def print_reading(
        self, stamp: int, faults: Sequence[Fault], events: Sequence[Event] = ()
    ) -> list[Event]:
        """Print what there is to tell of a reading, and return it.

        Args:
            stamp: stamp of the reading [ns since the epoch].
            faults: faults of the skin at the reading.
            events: events of the source since the reading before.
        """
        if self.lines is None:
            self.lines = EventLines(stamp)
        self.lines.pass_time(stamp)
        return self.print_events([*events, *self.reporter.report_faults(stamp, faults)])

    def finish(self) -> list[Event]:
        """Print what is not told yet, after the last reading, and return it."""
        told = self.print_events(self.reporter.finish())
        if self.lines is not None:
            self.lines.close()
        return told

    def print_events(self, events: list[Event]) -> list[Event]:
        """Print events, and return them."""
        for event in events:
            if self.lines is not None:
                self.lines.print_event(event)
        return events


@final
class TerminalPrinter(Listener):
    """A listener that prints what happens, with seconds since the stream began.

    Where the output is a terminal, its bell rings when the arm asks. Scans tell it that
    time has passed, so that patches that were only counted are printed while nothing
    else happens.
    """

    name = "terminal"
    message_types = (Detection, Event, CommandEvent, Scan)
    size = 1000
    drop: Drop = "oldest"

    def start(self, context: Context) -> None:
        """Print the column titles."""
        self.skin = context.info.skin
        self.lines = EventLines(context.clock.now())
        print(f"{'time':>8}  {'what':12} {'conf':>4}  where", flush=True)

    def on_message(self, item: Message) -> None:
        """Print a message, unless it is one of many of its kind at once."""
        if isinstance(item, Scan):
            self.lines.pass_time(item.stamp)
        elif isinstance(item, Event):
            self.lines.print_event(item)
        elif isinstance(item, Detection | CommandEvent):
            self.lines.close()
            self.write(item)

    def write(self, item: Detection | CommandEvent) -> None:
        """Print one line."""
        seconds = (item.stamp - self.lines.first) / NS_PER_S
        if isinstance(item, CommandEvent) and item.action == ASK:
            text = f"  {item.action:15}  {item.why}"
            text += BELL if sys.stdout.isatty() else ""
        elif isinstance(item, CommandEvent):
            outcome = "done" if item.accepted else "not done"
            text = f"  {item.action:15}  {outcome}: {item.why}"
        else:
            text = (
                f"{item.gesture:12} {item.confidence:4.0%}  "
                f"{describe_where(item, self.skin)}, {item.peak_force:.1f} N"
            )
        print(f"{seconds:7.2f}s  {text}", flush=True)

    def close(self) -> None:
        """Print the number of patches that were only counted."""
        self.lines.close()
