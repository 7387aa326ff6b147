"""Click on the moving arm of the demonstration's page, and count what is obeyed.

    python -m lab.page_clicks --minutes 10

A browser shows `eskin demo`, and the mouse acts on the forearm where it is visible: a
click pokes the arm at work, which is to pause it, and a click with shift grabs the
paused arm, which is to resume it. The arm rests between two motions of its task, so
that clicks meet it in motion and at rest; both are counted. A touch is obeyed where the
arm does so within `WAIT` of its end. Reasons that the page logs for others are printed.
"""

import time
from collections import Counter
from dataclasses import dataclass

import tyro

from lab.browser import Visit, becomes, chromium, new_tab, see
from lab.served_demo import ServedDemo
from lab.tables import format_head, format_row

WAIT = 2.0
"""Longest simulated time from a touch to the change of the arm [s]."""
REST = 1.5
"""Simulated time between two touches: an arm resumes after a second untouched [s]."""
VISIBLE = 0.3
"""Least cosine between the normal of a clicked taxel and the view."""


@dataclass(frozen=True)
class Command:
    """Click on the arm of the demonstration."""

    minutes: float = 10.0
    """Simulated time [min]."""
    seed: int = 4
    """Seed, as of `eskin demo`."""
    pace: float = 0.5
    """Seconds of simulated time per second of real time; a browser without a graphics
    card draws slowly."""
    scale: float = 0.4
    """Rendered points per pixel."""


def main() -> None:
    """Click, and print a table."""
    command = tyro.cli(Command)
    touches: Counter[tuple[str, str]] = Counter()
    obeyed: Counter[tuple[str, str]] = Counter()
    with chromium() as browser, ServedDemo(command.seed, command.pace) as demo:
        tab = new_tab(browser, scale=command.scale)
        see(tab, demo.link)
        visit = Visit(tab, demo)
        end = time.monotonic() + 60.0 * command.minutes / command.pace
        while time.monotonic() < end:
            key, done = touch_once(visit, command.pace)
            touches[key] += 1
            obeyed[key] += done
        text = visit.text()
    print(format_head(["touch", "arm", "touches", "obeyed"]))
    for key, count in sorted(touches.items()):
        share = f"{obeyed[key]} ({obeyed[key] / count:.1%})"
        print(format_row([*key, str(count), share]))
    refused = [line for line in text.splitlines() if "not understood" in line]
    print(f"<!-- refused, of the last lines of the page: {refused} -->")


def touch_once(visit: Visit, pace: float) -> tuple[tuple[str, str], bool]:
    """Touch the arm by what would change its state, and return whether it did."""
    demo = visit.demo
    visit.let_go()
    becomes(lambda: visit.seen()[0].max() > VISIBLE, 60.0)
    paused = demo.state["paused"]
    name = "shift-click" if paused else "click"
    key = name, "in motion" if demo.state["moving"] else "at rest"
    (visit.grab if paused else visit.click)()
    done = becomes(lambda: demo.state["paused"] != paused, WAIT / pace)
    demo.wait(REST / pace)
    return key, done


if __name__ == "__main__":
    main()
