"""Touch the moving arm of the demonstration's page, and count what comes of it.

    python -m lab.page_clicks --touches 100

A browser shows `eskin demo`, and the mouse acts on the forearm where it is visible: a
click or a double click pauses the arm at work, a drag slows it, and after each a click
with shift makes it go on. A touch is answered where the log tells of it, named where
the log says what was meant, and obeyed where the arm does it, each within `WAIT`.
"""

import re
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import tyro

from lab.browser import PATIENCE, Visit, becomes, chromium, new_tab, see
from lab.served_demo import ServedDemo
from lab.tables import format_head, format_row

WAIT = 4.0
"""Longest simulated time from a touch to what comes of it [s]."""
REST = 1.5
"""Simulated time between two touches: an arm resumes after a second untouched [s]."""
SIZE = (1000, 500)
"""Width and height of the window [px]; software draws a larger one slowly."""
VISIBLE = 0.3
"""Least cosine between the normal of a clicked taxel and the view."""
ENTRY = re.compile(r"(\d+:\d\d\.\d)\s+(.+)")
"""Time and text of a line of the log."""
GESTURES = {
    "click": "poke",
    "double click": "double pat",
    "drag": "stroke",
    "shift-click": "grab",
}
ROUND = ("click", "shift-click", "double click", "shift-click", "drag", "shift-click")


@dataclass(frozen=True)
class Command:
    """Touch the arm of the demonstration."""

    touches: int = 100
    """Number of clicks, of double clicks and of drags."""
    seed: int = 4
    """Seed, as of `eskin demo`."""
    pace: float = 0.5
    """Seconds of simulated time per second of real time; a browser without a graphics
    card draws slowly."""
    scale: float = 0.4
    """Rendered points per pixel."""


@dataclass
class Count:
    """Counts what came of touches of one kind."""

    touches: int = 0
    """Number of touches."""
    seconds: dict[str, list[float]] = field(default_factory=dict)
    """Simulated time until each was answered, named and obeyed [s]."""

    def format(self, kind: str) -> str:
        """Return a row of the table."""
        cells = [kind, str(self.touches)]
        for what in ("answered", "named", "obeyed"):
            times = self.seconds.get(what, [])
            median = f", {np.median(times):.2f} s" if times else ""
            cells.append(f"{len(times)}{median}")
        return format_row(cells)


def main() -> None:
    """Touch, and print a table of counts and median times."""
    command = tyro.cli(Command)
    counts = {kind: Count() for kind in GESTURES}
    with chromium() as browser, ServedDemo(command.seed, command.pace) as demo:
        tab = new_tab(browser, SIZE, command.scale)
        see(tab, demo.link)
        visit = Visit(tab, demo)
        for _ in range(command.touches):
            for kind in ROUND:
                touch_once(visit, kind, counts[kind], command.pace)
    print(format_head(["mouse", "touches", "answered", "named rightly", "obeyed"]))
    for kind, count in counts.items():
        print(count.format(kind))


def touch_once(visit: Visit, kind: str, count: Count, pace: float) -> None:
    """Touch the arm, and count what comes of it."""
    prepare(visit, kind)
    state = visit.demo.state
    if kind == "shift-click" and not state["paused"] and state["speed"] == 1.0:
        return  # Nothing was paused or slowed that could go on.
    before, known = dict(visit.demo.state), set(ENTRY.findall(visit.text()))
    act: dict[str, Callable[[], None]] = {
        "click": visit.click,
        "double click": visit.double_click,
        "drag": visit.drag,
        "shift-click": visit.grab,
    }
    act[kind]()
    began, count.touches = time.monotonic(), count.touches + 1
    found: dict[str, float] = {}

    def is_over() -> bool:
        new = [text for _, text in set(ENTRY.findall(visit.text())) - known]
        seen = {
            "answered": any(text.startswith(("your ", "that was ")) for text in new),
            "named": any(text.startswith(f"{GESTURES[kind]} ") for text in new),
            "obeyed": obeys(kind, before, visit.demo.state),
        }
        passed = pace * (time.monotonic() - began)
        for what in (what for what, is_seen in seen.items() if is_seen):
            found.setdefault(what, passed)
        return len(found) == len(seen)

    becomes(is_over, WAIT / pace)
    for what, seconds in found.items():
        count.seconds.setdefault(what, []).append(seconds)
    visit.demo.wait(REST / pace)


def prepare(visit: Visit, kind: str) -> None:
    """Make the arm pausable or resumable by its buttons, and wait until it is seen."""
    state = visit.demo.state
    to_go_on = kind == "shift-click"
    if state["hold_reason"] or (state["paused"] and not to_go_on):
        visit.tab.get_by_role("button", name="resume").click()
        becomes(lambda: not visit.demo.state["paused"], PATIENCE)
    becomes(lambda: visit.seen()[0].max() > VISIBLE, PATIENCE)


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
