"""The page in a real browser: headless Chromium, with WebGL by software."""

import io
import threading
import time

import numpy as np
import pytest

from eskin.page import ArmSummary, LogEntry
from eskin.viewer.process import PageProcess
from helpers.viewer import Q, mounted, picture, setup

pytest.importorskip(
    "playwright.sync_api", reason="no playwright; pip install 'eskin[dev]'"
)
pytest.importorskip("PIL.Image", reason="no pillow; pip install 'eskin[dev]'")

from benchmarks.browser import CHROMIUM, EYE, PATIENCE, Canvas, chromium, new_tab, see
from PIL import Image

if not CHROMIUM.exists():
    pytest.skip(f"no {CHROMIUM}; apt-get install chromium", allow_module_level=True)


class Shown:
    """A page that is fed, with what it ordered and what its browser complained of."""

    def __init__(self, touchable):
        self.orders, self.complaints = [], []
        self.content = {}
        self.ending = threading.Event()
        self.process = PageProcess(setup(touchable), 0, self.orders.append)
        self.port = self.process.wait_ready(PATIENCE)
        self.feeder = threading.Thread(target=self.feed)
        self.feeder.start()

    def feed(self):
        began, log_entries = time.monotonic(), None
        while not self.ending.wait(0.04):
            content = dict(self.content)
            if content.get("log_entries") is log_entries:
                content.pop("log_entries", None)
            else:
                log_entries = content.get("log_entries")
            self.process.give(picture(time.monotonic() - began, **content))

    def close(self):
        self.ending.set()
        self.feeder.join()
        self.process.close()


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


def opened(browser, shown):
    tab = new_tab(browser)

    def note(message):
        if message.type == "error":
            shown.complaints.append(message.text)

    tab.on("console", note)
    tab.on("pageerror", lambda error: shown.complaints.append(str(error)))
    see(tab, shown.port)
    return tab


@pytest.fixture(scope="module")
def shown():
    shown = Shown(touchable=True)
    yield shown
    shown.close()


@pytest.fixture(scope="module")
def tab(browser, shown):
    tab = opened(browser, shown)
    yield tab
    tab.close()


def pixels(tab):
    shot = Image.open(io.BytesIO(tab.screenshot()))
    return np.asarray(shot.convert("RGB"), dtype=int)


def seen(tab, colour, within=40):
    """Where pixels of about a colour are in the scene, as (x, y)."""
    scene = pixels(tab)[:, :940]
    scene[:160, :330] = 255
    near = np.abs(scene - np.array(colour)).max(axis=-1) < within
    return np.argwhere(near)[:, ::-1]


def retried(action, condition, times=6, wait=5.0):
    """Software rendering is slow and the arm moves on: try again."""
    for _ in range(times):
        action()
        end = time.monotonic() + wait
        while time.monotonic() < end:
            if condition():
                return True
            time.sleep(0.1)
    return False


def at(tab, taxel):
    """Where a taxel is drawn in the page [px]."""
    return Canvas.of(tab).drawn_at(mounted().place_taxels(Q, np.array([taxel]))[0][0])


def facing(patch):
    """The taxel of a patch that looks most at the camera."""
    taxels = mounted().skin.find_taxels(patch)
    p_world, n_world = mounted().place_taxels(Q, taxels)
    away = EYE - p_world
    return int(taxels[np.argmax(np.einsum("ti,ti->t", n_world, away))])


TARGET = facing("forearm_back")


def test_the_page_draws_a_robot_in_its_skin_without_complaint(tab, shown):
    assert retried(lambda: None, lambda: len(seen(tab, (55, 15, 70), 30)) > 200)
    assert np.ptp(pixels(tab)[:, :940]) > 150
    assert not shown.complaints


def test_a_pressed_taxel_is_light_and_ringed(tab, shown):
    shown.content = {"taxel": TARGET}
    try:
        assert retried(lambda: None, lambda: len(seen(tab, (213, 94, 0), 45)) > 20)
        ring = seen(tab, (213, 94, 0), 45).mean(axis=0)
        assert np.linalg.norm(ring - at(tab, TARGET)) < 25
        tab.wait_for_selector("text=touch 3 on forearm_link")
    finally:
        shown.content = {}


def test_a_click_on_the_forearm_touches_the_forearm(tab, shown):
    def click():
        tab.mouse.click(*at(tab, TARGET))

    assert retried(click, lambda: shown.orders)
    order = shown.orders[0]
    assert (order.kind, order.link) == ("poke", "forearm_link")
    place = mounted().skin.positions[TARGET]
    assert np.linalg.norm(np.array(order.p_link) - place) < 0.02


def test_a_drag_on_the_skin_is_a_finger_that_moves(tab, shown):
    shown.orders.clear()
    x, y = at(tab, TARGET)

    def drag():
        tab.mouse.move(x, y)
        tab.mouse.down()
        for step in range(8):
            tab.mouse.move(x - 5 * step, y - 3 * step)
            time.sleep(0.1)
        tab.mouse.up()

    assert retried(drag, lambda: any(order.kind == "end" for order in shown.orders))
    kinds = [order.kind for order in shown.orders if order.kind != "poke"]
    assert kinds[0] == "begin" and "move" in kinds
    moved = [order for order in shown.orders if order.kind in ("begin", "move")]
    assert {order.link for order in moved} == {"forearm_link"}


def test_what_is_said_is_in_the_log_and_the_arm_says_why_it_stopped(tab, shown):
    line = ArmSummary("held", "stale skin", 0.5, "open", "rack")
    shown.content = {
        "log_entries": (LogEntry(1.0, "command", "next <b>"),),
        "arm": line,
    }
    tab.wait_for_selector("text=held: stale skin")
    tab.wait_for_selector("text=next <b>")
    shown.content = {}


def test_a_page_that_may_not_touch_has_nothing_to_touch_with(browser, tab):
    tab.goto("about:blank")  # Two pages at once draw four times as slowly.
    shown = Shown(touchable=False)
    try:
        tab = opened(browser, shown)
        assert retried(lambda: None, lambda: len(seen(tab, (55, 15, 70), 30)) > 200)
        tab.mouse.click(*at(tab, TARGET))
        time.sleep(1.0)
        assert tab.locator("text=force [N]").count() == 0
        assert not shown.orders and not shown.process.dropped
        tab.close()
    finally:
        shown.close()
