"""Take screenshots of the demonstration's page, at rest and in each gesture.

    python -m lab.page_shots --out FOLDER

In three windows: of a desktop, of a small laptop and of a phone. The demonstration runs
slower than life, because software rendering reaches only a few frames per second.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import tyro

from lab.browser import chromium, new_tab, see
from lab.served_demo import ServedDemo
from lab.visit import Visit, becomes

WINDOWS = ((1440, 900), (1024, 560), (390, 844))
"""Widths and heights of the windows [px]."""
SEED, PACE = 4, 0.15
ANSWER = 12.0
"""Longest time until a touch is shown as recognised [s]."""
TRIES = 3


@dataclass(frozen=True)
class Command:
    """Take the screenshots."""

    out: Path
    """Folder of the pictures."""
    windows: tuple[int, ...] = (0, 1, 2)
    """Windows, by their place among 1440x900, 1024x560 and 390x844."""


def show_touch(visit: Visit, touch: Callable[[], None], word: str) -> bool:
    """Touch until the page says a word more often, and return whether it does."""

    def says_more_than(before: int) -> bool:
        return visit.text().lower().count(word) > before

    for _ in range(TRIES):
        visit.let_go()
        visit.wait_calm()
        before = visit.text().lower().count(word)
        touch()
        if becomes(partial(says_more_than, before), ANSWER):
            return True
    return False


def take_shots(visit: Visit, out: Path, size: str) -> None:
    """Take the pictures of one window."""

    def take(name: str) -> None:
        visit.tab.screenshot(path=out / f"{size}-{name}.png")

    visit.wait_calm()
    take("rest")
    for name, touch, word in (
        ("poke", visit.click, "poke "),
        ("double-pat", visit.double_click, "double pat "),
        ("stroke", visit.drag, "stroke "),
        ("grab", visit.grab, "grab "),
    ):
        found = show_touch(visit, touch, word)
        take(name)
        print(f"{size} {name}: {'shown' if found else 'not shown'}", flush=True)


def main(command: Command) -> None:
    """Take the pictures of every window."""
    command.out.mkdir(parents=True, exist_ok=True)
    with chromium() as browser:
        for number in command.windows:
            with ServedDemo(SEED, PACE) as demo:
                tab = new_tab(browser, WINDOWS[number], scale=0.75)
                see(tab, demo.link)
                size = "{}x{}".format(*WINDOWS[number])
                take_shots(Visit(tab, demo), command.out, size)
                tab.close()


if __name__ == "__main__":
    main(tyro.cli(Command))
