"""Touch the moving arm of the demonstration's page, and count what comes of it.

    python -m lab.page_clicks --touches 100

A browser shows `eskin demo`, and the mouse acts on the forearm where the pointer is a
hand: a click or a double click pauses the arm at work, a drag slows it, and a click
with shift makes it go on, once another click answers the arm's question; in between,
the page's button does. A touch is logged where the log tells of it, and a hit unless
the arm has gone away meanwhile, as in a slow browser. It is named rightly where the
first gesture that the log names was made, and obeyed where the arm does what it asks
for, each within `WAIT`. What the log tells of others is printed.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import tyro

from lab.browser import PATIENCE, Visit, becomes, visit_demo
from lab.tables import format_head, format_row

WAIT = 6.0
"""Longest simulated time from a touch to what comes of it [s]."""
REST = 1.5
"""Simulated time between two touches: nothing may touch the skin in the second before
one that asks [s]."""
AFTER_FAILURE = 6.0
"""The same after a question that was not answered [s]."""
REACTION = 0.15
"""Simulated time from the question until the mouse moves to answer [s]."""
SIZE = (1000, 500)
"""Width and height of the window [px]; software draws a larger one slowly."""
VISIBLE = 0.3
"""Least visibility of the forearm at which it is clicked."""
ENTRY = re.compile(r"(\d+:\d\d\.\d)\s+(.+)")
"""Time and text of a line of the log."""
GESTURES = {
    "click": "poke",
    "double click": "double pat",
    "drag": "stroke",
    "shift-click": "grab",
}
NAME = re.compile(r"^(?:probably )?([a-z ]+) \d+%|\(probably a ([a-z ]+)\)")
"""A gesture that a line of the log names."""
RESULTS = ("logged", "hit", "named", "obeyed")
ROUND = ("click", "shift-click", "double click", "drag", "shift-click")


@dataclass(frozen=True)
class Command:
    """Touch the arm of the demonstration."""

    touches: int = 100
    """Number of clicks, of double clicks and of drags; twice as many go on."""
    seed: int = 4
    """Seed, as of `eskin demo`."""
    pace: float = 1.0
    """Seconds of simulated time per second of real time."""
    scale: float = 0.4
    """Rendered points per pixel; a browser without a graphics card draws slowly."""


@dataclass
class Count:
    """Counts what came of touches of one kind."""

    touches: int = 0
    """Number of touches."""
    seconds: dict[str, list[float]] = field(default_factory=dict)
    """Simulated time until each of `RESULTS` [s]."""

    def format(self, kind: str) -> str:
        """Return a row of the table."""
        cells = [kind, str(self.touches)]
        for what in RESULTS:
            times = self.seconds.get(what, [])
            median = f", {np.median(times):.2f} s" if times else ""
            cells.append(f"{len(times)}{median}")
        return format_row(cells)


def main() -> None:
    """Touch, and print a table of counts and median times."""
    command = tyro.cli(Command)
    counts = {kind: Count() for kind in GESTURES}
    with visit_demo(command.seed, command.pace, SIZE, command.scale) as visit:
        visit.close_notices()
        for done in range(command.touches):
            for kind in ROUND:
                touch_once(visit, kind, counts[kind])
            if done % 10 == 9 or done == command.touches - 1:
                print(format_head(["mouse", "touches", *RESULTS]))
                for kind, count in counts.items():
                    print(count.format(kind), flush=True)


def touch_once(visit: Visit, kind: str, count: Count) -> None:
    """Touch the arm, and count what comes of it."""
    prepare(visit, kind)
    before = visit.demo.state
    known = set(ENTRY.findall(visit.text()))
    if kind == "shift-click" and not before["paused"] and before["speed"] == 1.0:
        return  # Nothing was paused or slowed that could go on.
    act: dict[str, Callable[[], None]] = {
        "click": visit.click,
        "double click": visit.double_click,
        "drag": visit.drag,
        "shift-click": visit.grab,
    }
    try:
        act[kind]()
    except AssertionError as error:
        print(f"{kind}: not made, {error}", flush=True)
        if before["paused"]:
            visit.press_resume()
        return
    began = visit.demo.seconds
    count.touches = count.touches + 1
    found: dict[str, float] = {}
    question = visit.tab.locator("#question")
    is_answered = False

    def read_new() -> list[str]:
        entries = ENTRY.findall(visit.text())
        return [text for time, text in entries[::-1] if (time, text) not in known]

    def is_over() -> bool:
        nonlocal is_answered
        if kind == "shift-click" and not is_answered and question.count():
            visit.demo.rest(REACTION)
            visit.click()
            is_answered = True
        new = read_new()
        names = [one or other for text in new for one, other in NAME.findall(text)]
        seen = {
            "logged": any(text.startswith(("your ", "that was ")) for text in new),
            "hit": any(text.startswith("your ") for text in new),
            "named": names[:1] == [GESTURES[kind]],
            "obeyed": obeys(kind, before, visit.demo.state),
        }
        passed = visit.demo.seconds - began
        for what in (what for what, is_seen in seen.items() if is_seen):
            found.setdefault(what, passed)
        missed = seen["logged"] and not seen["hit"]
        return len(found) == len(seen) or missed or passed > WAIT

    becomes(is_over, PATIENCE)
    for what, seconds in found.items():
        count.seconds.setdefault(what, []).append(seconds)
    if kind == "drag" and "hit" not in found:
        visit.face_skin()
    asks = kind == "shift-click"
    visit.demo.rest(AFTER_FAILURE if asks and "obeyed" not in found else REST)
    if len(found) < len(RESULTS):
        print(f"{kind} only {' and '.join(found)}: {read_new()}", flush=True)


def prepare(visit: Visit, kind: str) -> None:
    """Make the arm pausable by its button, and so where no forearm is seen."""
    state = visit.demo.state
    is_seen = visit.seen()[0].max() > VISIBLE
    resumes = kind == "shift-click" and is_seen
    if state["hold_reason"] or (state["paused"] and not resumes):
        visit.press_resume()


def obeys(kind: str, before: dict[str, Any], now: dict[str, Any]) -> bool:
    """Return whether the arm has done what a touch asks for."""
    if kind in ("click", "double click"):
        return now["paused"] and not before["paused"]
    if kind == "drag":
        return now["speed"] < 1.0
    if before["paused"]:
        return not now["paused"]
    return now["speed"] == 1.0 > before["speed"]


if __name__ == "__main__":
    main()
