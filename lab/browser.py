"""Drive a headless Chromium with software WebGL, and locate points on the page."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from jaxtyping import Float
from playwright.sync_api import Browser, FloatRect, Page, sync_playwright

from eskin.page import SceneDescription
from eskin.page.scene import CAMERA_DIRECTION, FIELD_OF_VIEW, place_camera

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
CAMERA_TARGET = np.array(SceneDescription.middle)
CAMERA_DISTANCE = SceneDescription.distance
"""Point that the page's camera looks at [m], and its distance from there [m]."""
PATIENCE = 60.0
"""Longest time to wait for anything on the page [s]."""
EYE = CAMERA_TARGET + CAMERA_DISTANCE * CAMERA_DIRECTION
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

    def drawn_at(self, p_world: Float[np.ndarray, "3"]) -> tuple[float, float]:
        """Return where the tab shows [px] a point in the world frame [m]."""
        eye, target = place_camera(
            CAMERA_TARGET, CAMERA_DISTANCE, CAMERA_DIRECTION, self.x / self.half
        )
        ahead = (target - eye) / np.linalg.norm(target - eye)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        away = p_world - eye
        scale = self.half / (np.tan(FIELD_OF_VIEW / 2) * (away @ ahead))
        up = np.cross(right, ahead)
        return float(self.x + scale * away @ right), float(self.y - scale * away @ up)
