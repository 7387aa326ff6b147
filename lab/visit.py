"""Operate the page of the demonstration with the mouse, as a user would."""

import io
import time
from collections.abc import Callable
from functools import cache
from typing import final

import numpy as np
from jaxtyping import Float, Int
from PIL import Image
from playwright.sync_api import Page

from eskin.robot import load_robot
from eskin.skin import MountedSkin, load_skin
from lab.browser import EYE, PATIENCE, Canvas, see
from lab.served_demo import ServedDemo

LINK = "forearm_link"
ASIDE, BEFORE = 0.03, 0.06
"""Distance from a ray, and in front of a taxel, at which another taxel hides it [m]."""
SOME = np.arange(0, 2112, 3)
"""Taxels used to find out which parts are hidden."""
CALM = 4.0
"""Longest motion of the forearm in 0.2 s at which a click hits it [px]."""
LENGTH = 0.16
"""Length of a stroke [m]."""


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

    def let_go(self) -> None:
        """Press the button that resumes the task, if the arm is held."""
        if self.demo.state["hold_reason"]:
            self.tab.get_by_role("button", name="resume").click()
            becomes(lambda: not self.demo.state["hold_reason"], PATIENCE)

    def come_anew(self) -> None:
        """Reload the page, because a drag that missed the arm has turned the view."""
        see(self.tab, self.demo.link)

    def wait_calm(self) -> None:
        """Wait until the forearm is visible and hardly moves in the picture."""
        becomes(lambda: self.is_calm, PATIENCE)

    @property
    def is_calm(self) -> bool:
        """Return whether the forearm is visible and hardly moves in the picture."""
        before = self.middle()
        self.demo.wait(0.2)
        step = np.subtract(self.middle(), before)
        return bool(np.linalg.norm(step) < CALM and self.seen()[0].max() > 0.5)

    def click(self) -> None:
        """Poke by a click."""
        self.tab.mouse.click(*self.middle())

    def double_click(self) -> None:
        """Double pat by a double click."""
        self.tab.mouse.dblclick(*self.middle())

    def grab(self) -> None:
        """Grab by a click with shift held."""
        self.tab.keyboard.down("Shift")
        self.tab.mouse.click(*self.middle())
        self.tab.keyboard.up("Shift")

    def drag(self) -> None:
        """Stroke along the forearm as fast as the browser allows."""
        mouse = self.tab.mouse
        mouse.move(*self.along(-0.5))
        mouse.down()
        mouse.move(*self.along(0.5))
        mouse.up()

    def middle(self) -> tuple[float, float]:
        """Return where the middle of the forearm is drawn [px]."""
        return self.along(0.0)

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
        p_world, n_world = everywhere[own], normals[own]
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
