"""This module prints detections, events and commands as lines on the terminal."""

from typing import final

from eskin.drivers import Event
from eskin.live import Detection
from eskin.stream import CommandEvent, Context, Listener, Message, found_together
from eskin.stream.listener import Drop
from eskin.units import NS_PER_S, format_count

PATCH_KINDS = {"appeared", "silent", "returned", "slow", "on_rate", "late", "in_time"}
"""Kinds of events that many patches have at once, as when a cable is pulled."""
LISTED = 3
"""Number of patches with such an event that are printed; the others are counted."""
TOGETHER = NS_PER_S // 2
"""Longest time between two such events that are counted together [ns]."""


@final
class TerminalPrinter(Listener):
    """A listener that prints what happens, with seconds since the stream began.

    Of faults that are found together, it prints one and counts the others; of patches
    that appear or become silent together, three.
    """

    name = "terminal"
    message_types = (Detection, Event, CommandEvent)
    size = 1000
    drop: Drop = "oldest"

    def start(self, context: Context) -> None:
        """Print the column titles."""
        self.first = context.clock.now()
        self.fault: Event | None = None
        self.last: Event | None = None
        self.row = self.more = 0
        self.counted = ""
        print(f"{'time':>8}  {'what':12} {'conf':>4}  where", flush=True)

    def on_message(self, item: Message) -> None:
        """Print a message, unless it is one of many of its kind at once."""
        if not isinstance(item, Detection | Event | CommandEvent):
            return
        if isinstance(item, Event):
            counted = "fault" if found_together(self.fault, item) else ""
            counted = "patch" if self.follows_many(item) else counted
            if counted:
                self.more, self.counted = self.more + 1, counted
                return
        self.close()
        self.fault = item if isinstance(item, Event) else None
        self.write(item)

    def follows_many(self, event: Event) -> bool:
        """Return whether an event of a patch follows others of its kind at once."""
        last, self.last = self.last, event
        is_next = (
            last is not None
            and event.patch is not None
            and event.kind == last.kind
            and event.kind in PATCH_KINDS
            and event.stamp - last.stamp <= TOGETHER
        )
        self.row = self.row + 1 if is_next else 1
        return self.row > LISTED

    def write(self, item: Detection | Event | CommandEvent) -> None:
        """Print one line."""
        seconds = (item.stamp - self.first) / NS_PER_S
        if isinstance(item, Event):
            text = f"{item.kind:12} {'':4}  {item.text}"
        elif isinstance(item, CommandEvent):
            verdict = "done" if item.accepted else "not done"
            text = f"  {item.action:15}  {verdict}: {item.why}"
        else:
            text = (
                f"{item.gesture:12} {item.confidence:4.0%}  {item.patch} on "
                f"{item.link}, {item.peak_force:.1f} N"
            )
        print(f"{seconds:7.2f}s  {text}", flush=True)

    def close(self) -> None:
        """Print the number of faults or patches that were only counted."""
        if self.more:
            text = f"and {format_count(self.more, self.counted)} more"
            print(f"{'':8}  {'':12} {'':4}  {text}", flush=True)
        self.more = 0
