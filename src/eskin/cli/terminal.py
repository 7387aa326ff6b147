"""This module prints detections, events and commands as lines on the terminal."""

from typing import final

from eskin.drivers import Event
from eskin.live import Detection
from eskin.stream import CommandEvent, Context, Listener, Message, found_together
from eskin.stream.listener import Drop
from eskin.units import NS_PER_S, format_count


@final
class TerminalPrinter(Listener):
    """A listener that prints what happens, with seconds since the stream began.

    Of faults that are found together, it prints one and counts the others.
    """

    name = "terminal"
    message_types = (Detection, Event, CommandEvent)
    size = 1000
    drop: Drop = "oldest"

    def start(self, context: Context) -> None:
        """Print the column titles."""
        self.first = context.clock.now()
        self.fault: Event | None = None
        self.more = 0
        print(f"{'time':>8}  {'what':12} {'conf':>4}  where", flush=True)

    def on_message(self, item: Message) -> None:
        """Print a message, unless it is one of many faults found together."""
        if not isinstance(item, Detection | Event | CommandEvent):
            return
        if isinstance(item, Event) and found_together(self.fault, item):
            self.more += 1
            return
        self.close()
        self.fault = item if isinstance(item, Event) else None
        self.write(item)

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
        """Print the number of faults that were only counted."""
        if self.more:
            print(
                f"{'':8}  {'':12} {'':4}  and {format_count(self.more, 'fault')} more",
                flush=True,
            )
        self.more = 0
