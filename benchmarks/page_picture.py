"""A moving picture of the demonstration's page, from the real thing.

    python -m benchmarks.page_picture --out docs/pictures/demo.webp

Serves the demonstration on a slow clock, since software draws some pictures a second,
and plays what it sees at the speed of life. Mouse and clicks are real; the arrow of the
mouse, which no screenshot shows, is drawn into the page.
"""

import io
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import tyro
from PIL import Image
from playwright.sync_api import Page

from benchmarks.browser import chromium, new_tab, see
from benchmarks.served_demo import ServedDemo
from benchmarks.visit import Visit, becomes

SEED, PACE, SCALE = 4, 0.06, 0.75
TRIES = 5
SHORTEST, LONGEST = 40, 400
"""How long a picture is shown [ms]."""
LAST = 1500
"""How long the last one is [ms]."""
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
    """Take the picture."""

    out: Path
    """Where it goes: a .webp."""

    quality: int = 55
    """Of the picture, as WebP has it."""


@dataclass(frozen=True)
class Shot:
    """What the page looked like at a time."""

    stamp: int
    """By the demonstration's clock [ns]."""
    picture: Image.Image
    """The whole page."""


class Film:
    """Shots of one visit; final."""

    def __init__(self, visit: Visit) -> None:
        """Begin with nothing."""
        self.visit = visit
        self.shots: list[Shot] = []

    def take(self) -> None:
        """Take one."""
        stamp = self.visit.demo.state["stamp"]
        shot = Image.open(io.BytesIO(self.visit.tab.screenshot()))
        self.shots.append(Shot(stamp, shot.convert("RGB")))

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> None:
        """Take shots for a time by the demonstration's clock, or until something."""
        end = self.visit.demo.state["stamp"] + 1e9 * seconds
        while self.visit.demo.state["stamp"] < end and not until():
            self.take()

    def save(self, out: Path, quality: int) -> None:
        """Write it; each shot stays until the next."""
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
    """Serve, touch and take the picture."""
    command = tyro.cli(Command)
    with ServedDemo(SEED, PACE) as demo, chromium() as browser:
        tab = new_tab(browser, scale=SCALE)
        see(tab, demo.port)
        tab.evaluate(ARROW)
        clear(tab)
        visit = Visit(tab, demo)
        for number in range(TRIES):
            film = Film(visit)
            failed = play(film)
            if failed is None:
                film.save(command.out, command.quality)
                return
            print(f"take {number + 1} failed at {failed}", flush=True)
            begin_again(visit)
    raise SystemExit("no take succeeded")


def clear(tab: Page) -> None:
    """Close the hint that software draws."""
    tab.wait_for_timeout(3000)
    for button in tab.locator("button.mantine-Notification-closeButton").all():
        button.click()
    tab.wait_for_timeout(1000)


def play(film: Film) -> str | None:
    """Pause, go on, slow down, grip; which of them failed."""
    visit = film.visit
    demo = visit.demo
    becomes(lambda: demo.state["target"].startswith("over"), 600.0)
    demo.wait(0.3 / PACE)
    film.run(1.8)
    film.run(3.0, lambda: visit.is_calm)
    visit.click()
    film.run(1.5)
    if not demo.state["paused"]:
        return "pause"
    visit.click()
    film.run(1.2, lambda: not demo.state["paused"])
    if demo.state["paused"]:
        return "resume"
    film.run(0.3)
    visit.drag()
    film.run(1.6)
    if demo.state["speed"] == 1.0:
        return "slow"
    gripper = demo.state["gripper"]
    visit.grab()
    film.run(2.2)
    return "grab" if demo.state["gripper"] == gripper else None


def begin_again(visit: Visit) -> None:
    """Let the arm go on at full speed."""
    visit.tab.get_by_role("button", name="resume").click()
    if visit.demo.state["speed"] < 1.0:
        visit.drag()
        visit.demo.wait(2.0 / PACE)


if __name__ == "__main__":
    main()
