"""Record an animation of the demonstration's page.

    python -m lab.page_picture --out docs/pictures/demo.webp

The demonstration runs on a slow clock, because software rendering reaches only a few
frames per second; the animation plays in real time. Mouse and clicks are real; the
mouse pointer, which screenshots leave out, is drawn into the page.
"""

import io
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import final

import numpy as np
import tyro
from PIL import Image

from lab.browser import Visit, becomes, visit_demo

SEED = 7
PACE = 0.06
SCALE = 0.75
TRIES = 5
SHORTEST = 40
LONGEST = 400
"""Shortest and longest duration of a frame [ms]."""
LAST = 1500
"""Duration of the last frame [ms]."""
REST = 2.5
"""Simulated time from one touch to the next: nothing may touch the skin in the second
before one that asks [s]."""
CLOSING = 3.0
"""Longest simulated time from a touch until the arm asks, and from the answer until it
does what it was asked for [s]."""
REACTION = 0.4
"""Simulated time from the question to the click that answers [s]."""
AFTER_FAILURE = 6.0
"""Simulated time without a touch after a question that was not answered [s]."""
ARROW = """() => {
  const arrow = document.createElement("div");
  arrow.innerHTML = `<svg width="26" height="26" viewBox="0 0 24 24">
    <path d="M4 2 L4 19 L8.5 15 L11.5 21.5 L14.5 20 L11.5 14 L17.5 14 Z"
      fill="#1f2733" stroke="white" stroke-width="1.5"/></svg>`;
  arrow.style = "position:fixed;z-index:9999;pointer-events:none;left:20px;top:700px";
  document.body.append(arrow);
  const press = (width) => () => { arrow.firstChild.style.filter = width; };
  addEventListener("pointermove", (event) => {
    arrow.style.left = `${event.clientX - 4}px`;
    arrow.style.top = `${event.clientY - 2}px`;
  }, true);
  addEventListener("pointerdown", press("drop-shadow(0 0 7px #d55e00)"), true);
  addEventListener("pointerup", () => setTimeout(press(""), 1500), true);
}"""


@dataclass(frozen=True)
class Command:
    """Record the animation."""

    out: Path
    """Path of the .webp file."""
    quality: int = 55
    """WebP quality."""


@dataclass(frozen=True)
class Shot:
    """Holds a screenshot of the page."""

    stamp: int
    """Time of the demonstration's clock [ns]."""
    picture: Image.Image
    """Picture of the whole page."""


@final
class Film:
    """Collects the screenshots of one visit."""

    def __init__(self, visit: Visit) -> None:
        """Start without screenshots."""
        self.visit = visit
        self.shots: list[Shot] = []

    def take(self) -> None:
        """Take a screenshot."""
        stamp = self.visit.demo.state["stamp"]
        shot = Image.open(io.BytesIO(self.visit.tab.screenshot()))
        self.shots.append(Shot(stamp, shot.convert("RGB")))

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Take screenshots for a simulated time, or until a condition holds."""
        end = self.visit.demo.state["stamp"] + 1e9 * seconds
        while self.visit.demo.state["stamp"] < end and not until():
            self.take()

    def save(self, out: Path, quality: int) -> None:
        """Write the animation; each frame stays until the next."""
        frames = [shot.picture for shot in self.shots]
        times = [
            int(np.clip((after.stamp - shot.stamp) / 1e6, SHORTEST, LONGEST))
            for shot, after in pairwise(self.shots)
        ]
        frames[0].save(
            out,
            save_all=True,
            append_images=frames[1:],
            duration=[*times, LAST],
            loop=0,
            quality=quality,
            method=6,
        )
        print(f"{len(frames)} frames, {sum(times) / 1e3:.1f} s, {out.stat().st_size} B")


def main() -> None:
    """Serve the demonstration, touch the arm and record the animation."""
    command = tyro.cli(Command)
    with visit_demo(SEED, PACE, scale=SCALE) as visit:
        visit.tab.evaluate(ARROW)
        visit.close_notices()
        for number in range(TRIES):
            film = Film(visit)
            failed = play(film)
            if failed is None:
                film.save(command.out, command.quality)
                return
            print(f"take {number + 1} failed at {failed}", flush=True)
            begin_again(visit)
    raise SystemExit("no take succeeded")


def play(film: Film) -> str | None:
    """Pause, resume, slow down and go on; return the name of a step that failed."""
    visit = film.visit
    demo = visit.demo
    becomes(lambda: demo.state["target"].startswith("over"), 600.0)
    demo.wait(0.3 / PACE)
    film.run(1.8)
    film.run(3.0, lambda: visit.is_calm)
    visit.click()
    film.run(REST)
    if not demo.state["paused"]:
        return "pause"
    ask(film, lambda: not demo.state["paused"])
    if demo.state["paused"]:
        return "resume"
    film.run(0.3)
    visit.drag()
    film.run(REST)
    if demo.state["speed"] == 1.0:
        return "slow"
    ask(film, lambda: demo.state["speed"] == 1.0)
    film.run(1.0)
    return "full speed" if demo.state["speed"] < 1.0 else None


def ask(film: Film, is_done: Callable[[], bool]) -> None:
    """Grab, answer by a click where the arm asks, and wait until it is done."""
    visit = film.visit
    question = visit.tab.locator("#question")
    visit.grab()
    film.run(CLOSING, lambda: question.count() > 0)
    if question.count():
        film.run(REACTION)
        visit.click()
        film.run(CLOSING, is_done)


def begin_again(visit: Visit) -> None:
    """Resume the task at full speed, once no question hinders the next one."""
    visit.press_resume()
    visit.demo.rest(AFTER_FAILURE)
    if visit.demo.state["speed"] < 1.0:
        ask(Film(visit), lambda: visit.demo.state["speed"] == 1.0)


if __name__ == "__main__":
    main()
