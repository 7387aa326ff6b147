"""Headless Chromium that draws WebGL by software, and what it sees of a page."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
from jaxtyping import Float
from playwright.sync_api import Browser, FloatRect, Page, sync_playwright

from eskin.page.page import DISTANCE, MIDDLE
from eskin.page.scene import CAMERA, FIELD

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
PATIENCE = 60.0
"""How long anything on the page may take to come [s]."""
EYE = MIDDLE + DISTANCE * CAMERA
"""Where the page's camera is [m]."""


@contextmanager
def chromium() -> Iterator[Browser]:
    """A browser without a window, which gives way to whatever else runs."""
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
    """An empty tab.

    Args:
        browser: that has it.
        size: width and height of the window [px].
        scale: points drawn by a pixel; fewer are faster.
    """
    width, height = size
    tab = browser.new_page(
        viewport={"width": width, "height": height}, device_scale_factor=scale
    )
    tab.set_default_timeout(1000 * PATIENCE)
    return tab


def see(tab: Page, port: int) -> None:
    """Open a page of this computer, and wait until it shows what is felt."""
    tab.goto(f"http://127.0.0.1:{port}")
    tab.wait_for_selector("text=readings/s")


@dataclass(frozen=True)
class Canvas:
    """Where in a tab the page's scene is drawn, and how."""

    x: float
    """Its middle [px]."""
    y: float
    """[px]"""
    half: float
    """Half its height [px]."""

    @property
    def box(self) -> FloatRect:
        """All of it."""
        width, height = 2 * (self.x), 2 * self.half
        return FloatRect(x=0, y=self.y - self.half, width=width, height=height)

    @classmethod
    def of(cls, tab: Page) -> "Canvas":
        """The one of a tab."""
        box = tab.locator("canvas").first.bounding_box()
        assert box is not None
        half = box["height"] / 2
        return cls(box["x"] + box["width"] / 2, box["y"] + half, half)

    def drawn_at(self, p_world: Float[np.ndarray, "3"]) -> tuple[float, float]:
        """Where the page's camera shows a point of the world [m] in the tab [px]."""
        ahead = (MIDDLE - EYE) / np.linalg.norm(MIDDLE - EYE)
        right = np.cross(ahead, (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        away = p_world - EYE
        scale = self.half / (np.tan(FIELD / 2) * (away @ ahead))
        up = np.cross(right, ahead)
        return float(self.x + scale * away @ right), float(self.y - scale * away @ up)
