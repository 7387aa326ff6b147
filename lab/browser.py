"""Drive a headless Chromium with software WebGL, and touch the page as a user would."""

import io
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import final

import numpy as np
from jaxtyping import Float, Int
from PIL import Image
from playwright.sync_api import Browser, FloatRect, Page, sync_playwright

from eskin.page import SceneDescription
from eskin.page.scene import FIELD_OF_VIEW, place_camera
from eskin.robot import load_robot
from eskin.skin import MountedSkin, load_skin
from lab.served_demo import ServedDemo

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = (
    "--no-sandbox",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
)
PATIENCE = 180.0
"""Longest time to wait for anything on the page [s]."""
EYE = np.array(SceneDescription.middle) + SceneDescription.distance * np.array(
    SceneDescription.direction
)
"""Position of the page's camera in the world frame [m]."""


@contextmanager
def chromium() -> Iterator[Browser]:
    """Launch a headless browser at low priority, and close it at the end."""
    with TemporaryDirectory() as folder, sync_playwright() as runner:
        polite = Path(folder) / "chromium"
        polite.write_text(f'#!/bin/sh\nexec nice -n 5 {CHROMIUM} "$@"\n')
        polite.chmod(0o700)
        browser = runner.chromium.launch(executable_path=polite, args=list(FLAGS))
        try:
            yield browser
        finally:
            browser.close()


def new_tab(
    browser: Browser, size: tuple[int, int] = (1280, 800), scale: float = 1.0
) -> Page:
    """Open an empty tab.

    Args:
        browser: browser of the tab.
        size: width and height of the window [px].
        scale: rendered points per pixel; a lower scale is faster.
    """
    width, height = size
    tab = browser.new_page(
        viewport={"width": width, "height": height}, device_scale_factor=scale
    )
    tab.set_default_timeout(1000 * PATIENCE)
    return tab


def see(tab: Page, link: str) -> None:
    """Open the page by its link, and wait until it shows readings."""
    tab.goto(link)
    tab.wait_for_selector("text=readings/s")


@dataclass(frozen=True)
class Canvas:
    """Describes the canvas of the scene in a tab."""

    x: float
    """Horizontal position of its centre [px]."""
    y: float
    """Vertical position of its centre [px]."""
    half: float
    """Half of its height [px]."""

    @property
    def box(self) -> FloatRect:
        """Bounding box of the canvas."""
        width, height = 2 * (self.x), 2 * self.half
        return FloatRect(x=0, y=self.y - self.half, width=width, height=height)

    @classmethod
    def of(cls, tab: Page) -> "Canvas":
        """Return the canvas of a tab."""
        box = tab.locator("canvas").first.bounding_box()
        assert box is not None
        half = box["height"] / 2
        return cls(box["x"] + box["width"] / 2, box["y"] + half, half)

    def drawn_at(
        self,
        p_world: Float[np.ndarray, "3"],
        view: SceneDescription | type[SceneDescription] = SceneDescription,
    ) -> tuple[float, float]:
        """Return where the tab shows [px] a point in the world frame [m].

        Args:
            p_world: the point.
            view: scene whose camera shows it; by default the demonstration's.
        """
        camera = np.array(view.middle), view.distance, np.array(view.direction)
        eye, target = place_camera(*camera, self.x / self.half)
        ahead = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        away = p_world - eye
        scale = self.half / (np.tan(FIELD_OF_VIEW / 2) * (away @ ahead))
        up = np.cross(right, ahead)
        return float(self.x + scale * away @ right), float(self.y - scale * away @ up)


LINK = "forearm_link"
ASIDE = 0.03
BEFORE = 0.06
"""Distance from a ray, and in front of a taxel, at which another taxel hides it [m]."""
SOME = np.arange(0, 2112, 3)
"""Taxels used to find out which parts are hidden."""
CALM = 4.0
"""Longest motion of the forearm in 0.2 s at which a click hits it [px]."""
LENGTH = 0.12
"""Length of a stroke [m]."""
CURSOR = "document.querySelector('canvas[data-engine]').style.cursor"
NOTICED = 3000
"""Time until the page shows its notices [ms]."""


@final
class Visit:
    """Reads the page and touches the forearm of the arm in it."""

    def __init__(self, tab: Page, demo: ServedDemo) -> None:
        """Store the tab and the demonstration.

        Args:
            tab: tab that shows the page.
            demo: demonstration behind the page.
        """
        self.tab = tab
        self.demo = demo
        self.canvas = Canvas.of(tab)

    def text(self) -> str:
        """Return the text of the page."""
        return str(self.tab.evaluate("document.body.innerText"))

    def scene(self) -> Int[np.ndarray, "row column 3"]:
        """Return the picture of the scene: red, green and blue."""
        shot = self.tab.screenshot(clip=self.canvas.box, scale="css")
        return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"), dtype=np.int64)

    def press_resume(self) -> None:
        """Press the button that resumes the task."""
        self.tab.get_by_role("button", name="resume").click()
        assert becomes(lambda: not self.demo.state["paused"], PATIENCE)

    def face_skin(self) -> None:
        """Turn the view back, from where a drag beside the skin has turned it."""
        self.tab.keyboard.press("r")

    def close_notices(self) -> None:
        """Close the notice about software rendering, which comes after a moment."""
        self.tab.wait_for_timeout(NOTICED)
        for button in self.tab.locator(".mantine-Notification-closeButton").all():
            button.click()
        self.tab.wait_for_timeout(1000)

    def aim(self, share: float = 0.0) -> None:
        """Move the mouse to the forearm, until the pointer is a hand.

        Args:
            share: as of `along`.
        """
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            x, y = self.along(share)
            # A browser looks for what is under a mouse only when that has moved.
            self.tab.mouse.move(x + 1, y)
            self.tab.mouse.move(x, y)
            if self.tab.evaluate(CURSOR) == "pointer":
                return
        raise AssertionError("the pointer becomes no hand")

    @property
    def is_calm(self) -> bool:
        """Return whether the forearm is visible and hardly moves in the picture."""
        before = self.along(0.0)
        self.demo.wait(0.2)
        step = np.subtract(self.along(0.0), before)
        return bool(np.linalg.norm(step) < CALM and self.seen()[0].max() > 0.5)

    def press(self) -> None:
        """Press and release the mouse where it is."""
        self.tab.mouse.down()
        self.tab.mouse.up()

    def click(self) -> None:
        """Poke by a click."""
        self.aim()
        self.press()

    def double_click(self) -> None:
        """Pat twice by a double click."""
        self.aim()
        self.press()
        self.press()

    def choose(self, mode: str) -> None:
        """Choose what a click makes, as on a phone."""
        self.tab.get_by_label("a click is a").click()
        self.tab.get_by_role("option", name=mode).click()

    def grab(self) -> None:
        """Grab by a click with shift held."""
        self.aim()
        self.tab.keyboard.down("Shift")
        self.press()
        self.tab.keyboard.up("Shift")

    def drag(self) -> None:
        """Stroke along the forearm, as it moves."""
        self.aim(-0.5)
        self.tab.mouse.down()
        for share in (-0.25, 0.0, 0.25, 0.5):
            self.tab.mouse.move(*self.along(share))
        self.tab.mouse.up()

    def along(self, share: float) -> tuple[float, float]:
        """Return where a point of a stroke along the forearm is drawn [px].

        Args:
            share: distance from the middle as a share of the stroke's length.
        """
        seen, p_world = self.seen()
        front = p_world[seen > np.quantile(seen, 0.8)]
        axis = np.linalg.svd(front - front.mean(0), full_matrices=False)[2][0]
        axis *= np.sign(axis[2]) or 1.0
        return self.canvas.drawn_at(p_world[np.argmax(seen)] + LENGTH * share * axis)

    def seen(self) -> tuple[Float[np.ndarray, "taxel"], Float[np.ndarray, "taxel 3"]]:
        """Return the visibility of some taxels of the forearm, and their positions [m].

        It is highest in the middle where a taxel faces the camera; -1 if it is hidden.
        """
        everywhere, normals = mounted().place_taxels(self.demo.q_shown, SOME)
        own = mounted().taxel_link_index[SOME] == mounted().robot.link_index(LINK)
        p_world = everywhere[own]
        n_world = normals[own]
        rays = p_world - EYE
        depth = np.linalg.norm(rays, axis=1)
        rays /= depth[:, None]
        ahead = (everywhere - EYE) @ rays.T
        away = np.linalg.norm(everywhere - EYE, axis=1)[:, None]
        is_near = away**2 - ahead**2 < ASIDE**2
        hidden = (is_near & (ahead < depth - BEFORE)).any(axis=0)
        facing = -np.einsum("ti,ti->t", rays, n_world)
        aside = np.linalg.norm(p_world - p_world.mean(0), axis=1)
        return np.where(hidden, -1.0, facing - 4.0 * aside), p_world


@contextmanager
def visit_demo(
    seed: int, pace: float, size: tuple[int, int] = (1280, 800), scale: float = 1.0
) -> Iterator[Visit]:
    """Serve `eskin demo`, and visit its page.

    Args:
        seed: seed, as of `eskin demo`.
        pace: seconds of simulated time per second of real time.
        size: width and height of the window [px].
        scale: as of `new_tab`.
    """
    with chromium() as browser, ServedDemo(seed, pace) as demo:
        tab = new_tab(browser, size, scale)
        see(tab, demo.link)
        yield Visit(tab, demo)


@cache
def mounted() -> MountedSkin:
    """Return the UR5 in its skin."""
    return MountedSkin(load_skin("ur5"), load_robot("ur5"))


def becomes(condition: Callable[[], bool], seconds: float) -> bool:
    """Wait until a condition is true, and return whether it was in time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            return False
        time.sleep(0.05)
    return True
