"""Tests of the pages in headless Chromium, which draws WebGL by software."""

import io
import threading
import time
from functools import partial

import numpy as np
import pytest

from eskin.calibration import PressRequest
from eskin.cli.guided import build_place
from eskin.design.paint_viewer import PaintViewer
from eskin.page import (
    ArmSummary,
    GuideBoard,
    LogEntry,
    PageOrder,
    QuestionBoard,
)
from eskin.page.appearance import describe_scene
from eskin.page.process import PageProcess, free_port
from eskin.page.viewer import CalibrationViewer, ViewerConfig
from eskin.touch import Calibration, Scan, TouchPipeline
from helpers.viewer import Q, make_setup, make_update, mounted

pytest.importorskip("playwright.sync_api", reason="no playwright; pip install '.[dev]'")
pytest.importorskip("PIL.Image", reason="no pillow; pip install '.[dev]'")

from PIL import Image

from lab.browser import (
    CHROMIUM,
    EYE,
    PATIENCE,
    Canvas,
    Visit,
    becomes,
    chromium,
    new_tab,
    see,
)
from lab.served_demo import ServedDemo

if not CHROMIUM.exists():
    pytest.skip(f"no {CHROMIUM}; apt-get install chromium", allow_module_level=True)

pytestmark = pytest.mark.slow

RESTING = (150, 160, 172)
RING = (0, 90, 181)
PLACE = (231, 41, 138)
"""Colours of taxels at rest, and of rings around a contact and a place to press."""
SCALE = 0.5
"""Rendered points per CSS pixel."""
PACE = 0.5
"""Half as fast as life: software draws slowly."""
TRIES = 6
WAIT = 14.0
"""How long a touch may take to be obeyed, and the skin rests before the next [s]."""
REACTION = 0.15
"""Simulated time before a person aims to answer what the page shows [s]."""


IDLE = """
window.requestAnimationFrame = draw =>
    setTimeout(() => draw(performance.now()), 250);
window.cancelAnimationFrame = clearTimeout;
const drawing = WebGL2RenderingContext.prototype;
for (const name of Object.getOwnPropertyNames(drawing)) {
    if (!/^(draw[AE]|clear$|clearBuffer|blit)/.test(name)) continue;
    const act = drawing[name];
    drawing[name] = function (...what) { if (window.isSeen) act.apply(this, what); };
}
window.see = async () => {
    await new Promise(done => setTimeout(done, 500));
    window.isSeen = true;
    await new Promise(requestAnimationFrame);
    window.isSeen = false;
};
"""
"""Lets a tab be drawn only where its picture is taken, which then stays: software takes
a second of a core to draw it. All else goes on four times a second."""


def new_slow_tab(browser):
    """Open a tab that is drawn where `take_shot` asks for it."""
    tab = new_tab(browser, scale=SCALE)
    tab.add_init_script(IDLE)
    return tab


def take_shot(tab):
    """Return what a tab shows by CSS pixels, of which software renders every other."""
    tab.evaluate("window.see()")
    shot = Image.open(io.BytesIO(tab.screenshot())).convert("RGB")
    return np.asarray(shot.resize((1280, 800), Image.Resampling.NEAREST), dtype=int)


class FedPage:
    """A page that gets updates, with its orders and the errors of its browser."""

    def __init__(self, browser, touchable=True):
        self.orders = []
        self.errors = []
        self.content = {}
        self.ending = threading.Event()
        self.process = PageProcess(make_setup(touchable), 0, self.orders.append)
        self.feeder = threading.Thread(target=self.feed)
        self.link = self.process.wait_ready(PATIENCE)
        self.feeder.start()
        self.tab = new_slow_tab(browser)
        self.tab.on("console", self.note)
        self.tab.on("pageerror", lambda error: self.errors.append(str(error)))
        see(self.tab, self.link)

    def note(self, message):
        if message.type == "error":
            self.errors.append(message.text)

    def feed(self):
        """Give updates; each log entry only once."""
        began = time.monotonic()
        sent = None
        while not self.ending.wait(0.1):
            content = dict(self.content)
            entries = content.pop("log_entries", ())
            if entries is not sent:
                content["log_entries"] = sent = entries
            self.process.give(make_update(time.monotonic() - began, **content))

    def close(self):
        self.tab.close()
        self.ending.set()
        self.feeder.join()
        self.process.close()

    def pixels(self):
        return take_shot(self.tab)[:, :940]

    def find(self, colour, tolerance):
        """Return where the scene is drawn in about a colour, as (x, y)."""
        scene = self.pixels()
        scene[:200, :330] = 255
        near = np.abs(scene - np.array(colour)).max(axis=-1) < tolerance
        return np.argwhere(near)[:, ::-1]

    def place(self, taxel, q=Q):
        """Return where a taxel is drawn in the page [px]."""
        p_world, _ = mounted().place_taxels(q, np.array([taxel]))
        return Canvas.of(self.tab).drawn_at(p_world[0])

    def shows_skin(self):
        return becomes(lambda: len(self.find(RESTING, 30)) > 200, PATIENCE)


def becomes_after(action, condition):
    """Repeat an action until it has its effect: the browser is slow."""
    return any(action() or becomes(condition, 5.0) for _ in range(12))


def find_facing_taxel(patch, q=Q):
    """Return the taxel of a patch that faces the camera most."""
    taxels = mounted().skin.find_taxels(patch)
    p_world, n_world = mounted().place_taxels(q, taxels)
    return int(taxels[np.argmax(np.einsum("ti,ti->t", n_world, EYE - p_world))])


TARGET = find_facing_taxel("forearm_back")


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


@pytest.fixture(scope="module")
def page(browser):
    page = FedPage(browser)
    yield page
    page.close()


def test_page_draws_robot_in_skin_without_errors(page):
    assert page.shows_skin()
    assert np.ptp(page.pixels()) > 150
    assert page.tab.get_by_text("no certified safety function").count() == 1
    assert not page.errors


def test_pressed_taxel_is_ringed(page):
    assert not len(page.find(RING, 45))
    page.content = {"taxel": TARGET}
    try:
        assert becomes(lambda: len(page.find(RING, 45)) > 20, PATIENCE)
        ring = page.find(RING, 45).mean(axis=0)
        assert np.linalg.norm(ring - page.place(TARGET)) < 25
        page.tab.wait_for_selector("text=touch 3 on forearm back")
    finally:
        page.content = {}


def test_click_on_forearm_touches_forearm(page):
    def click():
        page.tab.mouse.click(*page.place(TARGET))

    assert becomes_after(click, lambda: page.orders)
    order = page.orders[0]
    assert (order.kind, order.link) == ("poke", "forearm_link")
    place = mounted().skin.positions[TARGET]
    assert np.linalg.norm(np.array(order.p_link) - place) < 0.02


def test_click_hits_the_forearm_from_behind(page):
    """The planes of the links, seen from behind, are no part of the skin."""
    q = Q + np.array([0.4, 0, 0, 0, 0, 0])
    taxel = find_facing_taxel("forearm_back", q)
    page.content = {"q": q}
    try:
        assert becomes(lambda: np.ptp(page.pixels()) > 150, PATIENCE)
        time.sleep(2.0)
        page.orders.clear()
        assert becomes_after(
            lambda: page.tab.mouse.click(*page.place(taxel, q)), lambda: page.orders
        )
        place = mounted().skin.positions[taxel]
        assert np.linalg.norm(np.array(page.orders[0].p_link) - place) < 0.02
    finally:
        page.content = {}


@pytest.mark.long
def test_drag_on_skin_moves_finger(page):
    page.orders.clear()
    x, y = page.place(TARGET)

    def drag():
        page.tab.mouse.move(x, y)
        page.tab.mouse.down()
        for step in range(8):
            page.tab.mouse.move(x - 5 * step, y - 3 * step)
            time.sleep(0.1)
        page.tab.mouse.up()

    def has_ended():
        return any(order.kind == "end" for order in page.orders)

    assert becomes_after(drag, has_ended)
    finger = [order for order in page.orders if order.kind != "poke"]
    kinds = [order.kind for order in finger]
    assert kinds[0] == "begin" and "move" in kinds
    assert {order.link for order in finger} == {"forearm_link"}


def test_press_that_lasts_touches_from_then_until_its_release(page):
    page.orders.clear()
    mouse = page.tab.mouse

    def press():
        mouse.up()
        mouse.move(*page.place(TARGET))
        mouse.down()

    assert becomes_after(press, lambda: page.orders)
    assert becomes(lambda: len(page.orders) == 2, PATIENCE)
    time.sleep(1.0)
    begin, move = page.orders
    assert (begin.kind, move.kind, begin.link) == ("begin", "move", "forearm_link")
    place = mounted().skin.positions[TARGET]
    assert np.linalg.norm(np.array(begin.p_link) - place) < 0.02
    assert np.linalg.norm(np.subtract(move.p_link, begin.p_link)) < 0.02
    mouse.up()
    assert becomes(lambda: page.orders[-1].kind == "end", PATIENCE)
    time.sleep(1.0)
    assert {order.key for order in page.orders} == {begin.key}


@pytest.mark.parametrize("name", ["Last 10 s", "Skin"])
def test_tab_begins_in_the_upper_part_of_a_low_window(page, name):
    tab = page.tab
    tabs = tab.get_by_role("tab")
    tab.set_viewport_size({"width": 900, "height": 600})
    try:
        tabs.filter(has_text=name).click()
        tab.wait_for_timeout(1000)
        boxes = [each.bounding_box() for each in tabs.all()]
        assert len({box["y"] for box in boxes}) == 1
        assert boxes[0]["y"] + boxes[0]["height"] < 420
    finally:
        tabs.first.click()
        tab.set_viewport_size({"width": 1280, "height": 800})


@pytest.mark.parametrize("label", ["pause", "resume"])
def test_button_of_the_task_leaves_a_line_in_the_log(page, label):
    page.orders.clear()
    find_button(page.tab, label).first.click()
    page.tab.wait_for_selector(f"text=you pressed {label}")
    assert becomes(lambda: page.orders, PATIENCE)
    assert page.orders == [PageOrder(f"{label}_task")]


def test_page_shows_log_and_reason_of_hold(page):
    page.content = {
        "log_entries": (LogEntry(1.0, "command", "next <b>"),),
        "arm": ArmSummary("held", "stale skin", 0.5, "open", "rack", "poke it"),
    }
    page.tab.wait_for_selector("text=The arm is stopped")
    page.tab.wait_for_selector("text=stale skin")
    page.tab.wait_for_selector("text=poke it")
    page.tab.wait_for_selector("text=next <b>")
    page.content = {}


COUNT_TONES = """() => {
    window.tones = 0;
    const make = AudioContext.prototype.createOscillator;
    AudioContext.prototype.createOscillator = function () {
        window.tones += 1;
        return make.call(this);
    };
}"""
NO_SOUND = "() => { window.tones = 0; delete window.AudioContext; }"


@pytest.mark.parametrize(("sound", "tones"), [(COUNT_TONES, 2), (NO_SOUND, 0)])
def test_question_is_shown_across_the_scene_with_a_sound(page, sound, tones):
    tab = page.tab
    widths = []
    page.errors.clear()
    tab.reload()
    tab.wait_for_selector("text=readings/s")
    tab.evaluate(sound)
    tab.mouse.click(200, 700)
    for left in (0.9, 0.3):
        asked = QuestionBoard("poke", 0.0, "next_waypoint", "forearm_link", left)
        page.content = {"question": asked}
        tab.wait_for_function(
            f"document.querySelector('#question i')?.style.width === '{100 * left:g}%'"
        )
        tab.wait_for_timeout(500)
        widths.append(tab.locator("#question i").bounding_box()["width"])
    text = tab.locator("#question").inner_text().splitlines()
    assert text == ["Next waypoint?", "Poke the forearm link (click)"]
    assert widths[0] == pytest.approx(3 * widths[1], rel=0.01)
    assert tab.evaluate("window.tones") == tones
    page.content = {}
    tab.wait_for_selector("#question", state="detached")
    assert not page.errors


def test_click_beside_the_skin_is_answered_and_touches_nothing(page):
    page.orders.clear()

    def click():
        page.tab.mouse.click(200, 700)

    def is_answered():
        return page.tab.get_by_text("that was beside the skin").count() > 0

    assert becomes_after(click, is_answered)
    assert not page.orders


def test_page_that_may_not_touch_has_no_controls(browser, page):
    """Orders that it sends nevertheless are dropped: see `test_viewer.py`."""
    assert page.tab.locator("text=duration: 1 = usual").count()
    page.tab.goto("about:blank")  # Two pages at once draw four times as slowly.
    page = FedPage(browser, touchable=False)
    try:
        assert page.tab.locator("text=duration: 1 = usual").count() == 0
    finally:
        page.close()


def test_browser_without_webgl_has_the_panel_and_says_what_is_missing(browser):
    blind = browser.browser_type.launch(
        executable_path=CHROMIUM, args=["--no-sandbox", "--disable-3d-apis"]
    )
    with blind:
        page = FedPage(blind)
        try:
            tab = page.tab
            told = tab.locator("#no-scene").inner_text()
            assert "this browser has no WebGL" in told and "hardware" in told
            page.content = {
                "log_entries": (LogEntry(1.0, "command", "next step"),),
                "arm": ArmSummary("paused", "", 0.5, "open", "rack"),
            }
            tab.wait_for_selector("text=next step")
            tab.wait_for_selector("text=The arm is paused")
            find_button(tab, "pause").first.click()
            assert becomes(lambda: page.orders, PATIENCE)
            # Nobody touches what they do not see.
            page.orders.clear()
            tab.mouse.click(*page.place(TARGET))
            tab.wait_for_timeout(1000)
            assert not page.orders
        finally:
            page.close()


def find_button(tab, name):
    return tab.get_by_role("button", name=name)


@pytest.fixture
def calibrated(browser):
    """A page that guides through a calibration, and its tab."""
    viewer = CalibrationViewer(mounted(), 50.0, ViewerConfig(free_port(0)))
    tab = new_slow_tab(browser)
    try:
        tab.goto(viewer.page.wait_ready(PATIENCE))
        yield viewer, tab
    finally:
        tab.close()
        viewer.close()


def test_page_guides_through_calibration(calibrated):
    viewer, tab = calibrated
    skin = mounted().skin
    pipeline = TouchPipeline(mounted(), Calibration.uniform(skin.count, 4095, 400.0))
    counts = np.full(skin.count, 200, np.int32)
    received = np.ones(skin.count, bool)
    stamps = iter(range(40_000_000, 10**18, 200_000_000))

    def show(board):
        viewer.show(pipeline.push_scan(Scan(next(stamps), counts, received, Q)), board)

    find = partial(find_button, tab)

    def count_place():
        middle = take_shot(tab)[300:500, 380:580]
        return np.count_nonzero(np.abs(middle - PLACE).max(axis=-1) < 45)

    assert becomes(lambda: viewer.is_opened, PATIENCE)
    show(GuideBoard("hands off for 5 s", 0.5))
    tab.wait_for_selector("text=hands off for 5 s")
    assert not find("Skip").is_visible() and not count_place()
    assert not find("Repeat the last press").is_visible()
    # Also where the place is on the far side: the camera turns to it.
    for number, patch in enumerate(("forearm_front", "forearm_back"), 1):
        taxel = int(skin.find_taxels(patch)[200])
        request = PressRequest(patch, taxel, tuple(skin.positions[taxel].tolist()))
        place = build_place(request, mounted())
        viewer.tell("felt on <b>")
        show(GuideBoard(f"press {patch}", 0.5, place, presses=number))
        tab.wait_for_selector(f"text=press {patch}")
        assert becomes(lambda: count_place() > 20, PATIENCE)
        find(f"Skip {patch.replace('_', ' ')}").click()
        assert becomes(lambda patch=patch: viewer.skipped == patch, PATIENCE)
        find("Repeat the last press").click()
        assert becomes(lambda number=number: viewer.repeated == number, PATIENCE)
    assert tab.get_by_text("felt on <b>").count() == 2
    show(GuideBoard("finished", 1.0, None, ("gain x 2.00",)))
    tab.wait_for_selector("text=gain x 2.00")
    assert becomes(lambda: not count_place(), PATIENCE)
    assert not find("Repeat the last press").is_visible()
    assert not viewer.closed.is_set()
    find("Close").click()
    viewer.wait_closed()


def test_drag_over_robot_paints_what_is_saved(browser):
    saved = []

    def save(balls):
        saved[:] = [balls]
        return "saved: it"

    earlier = np.zeros((2, mounted().skin.count), bool)
    config = ViewerConfig(free_port(0))
    viewer = PaintViewer(mounted(), save, earlier, 100, pytest.fail, config)
    tab = new_slow_tab(browser)
    link = int(mounted().taxel_link_index[TARGET])
    q = np.zeros(6)
    p_world = mounted().kinematics.poses(q)[link] @ np.append(
        mounted().skin.positions[TARGET], 1.0
    )
    try:
        tab.goto(viewer.page.wait_ready(PATIENCE))
        tab.wait_for_selector("text=Drag over the robot")
        view = describe_scene(mounted(), (), q)
        x, y = Canvas.of(tab).drawn_at(p_world[:3], view)

        def drag():
            tab.mouse.move(x, y)
            tab.mouse.down()
            for step in range(6):
                tab.mouse.move(x + 6 * step, y)
                time.sleep(0.3)
            tab.mouse.up()

        find = partial(find_button, tab)
        # A drag beside the robot turns the view, so the robot must be drawn first.
        assert becomes_after(lambda: tab.mouse.click(x, y), lambda: viewer.balls)
        clicks = len(viewer.balls)
        assert becomes_after(drag, lambda: len(viewer.balls) > clicks)
        assert becomes(lambda: viewer.find_painted()[0].any(), PATIENCE)
        find("Save").click()
        tab.wait_for_selector("text=saved: it")
        assert len(saved[0]) > 1
        while viewer.balls:
            before = len(viewer.balls)
            find("Undo").click()
            assert becomes(lambda before=before: len(viewer.balls) < before, PATIENCE)
        find("Close").click()
        viewer.wait_closed()
    finally:
        tab.close()
        viewer.close()


@pytest.fixture
def visit(browser):
    with ServedDemo(4, PACE) as demo:
        tab = new_tab(browser, scale=SCALE)
        see(tab, demo.link)
        yield Visit(tab, demo)
        tab.close()


def touch_until_executed(visit, touch, line, condition):
    """Touch until the arm executes it and the page logs it: recognition may fail."""
    for _ in range(TRIES):
        if visit.demo.state["hold_reason"]:
            visit.press_resume()
        before = visit.demo.state
        count = visit.text().count(line)
        touch()
        if becomes(
            lambda before=before, count=count: (
                condition(before, visit.demo.state) and visit.text().count(line) > count
            ),
            WAIT,
        ):
            return
    pytest.fail(f"no '{line}' in {TRIES} touches; {visit.demo.state}; {visit.text()}")


def ask(visit, touch):
    """Touch, and answer where the arm asks."""
    touch()
    if becomes(lambda: visit.tab.locator("#question").count(), WAIT):
        visit.demo.rest(REACTION)
        visit.click()


def scene_moves(visit):
    before = visit.scene()
    return np.abs(visit.scene() - before).max() > 60


def execute(visit, touch, line, condition, shown):
    touch_until_executed(visit, touch, f"{line} on forearm", condition)
    assert becomes(lambda: shown(visit.demo.state) in visit.text(), PATIENCE)


@pytest.mark.long
def test_click_pauses_and_grab_resumes_arm_of_demonstration(visit):
    q = visit.demo.state["q"]
    assert becomes(lambda: scene_moves(visit), PATIENCE)
    assert not np.allclose(visit.demo.state["q"], q)

    def is_paused(before, now):
        return now["paused"] and not before["paused"]

    execute(
        visit, visit.click, "paused (poke", is_paused, lambda state: "arm is paused\n"
    )
    assert becomes(lambda: not visit.demo.state["moving"], PATIENCE)
    assert becomes(lambda: not scene_moves(visit), PATIENCE)
    q = visit.demo.state["q"]
    visit.demo.wait(1.5 / PACE)
    assert visit.demo.state["q"] == q

    def is_resumed(before, now):
        return is_paused(now, before)

    resume = "resumed (grab"
    grab = partial(ask, visit, visit.grab)
    execute(visit, grab, resume, is_resumed, lambda state: "arm is running\n")
    assert becomes(lambda: scene_moves(visit), PATIENCE)


@pytest.mark.long
def test_every_other_gesture_commands_arm(visit):
    """A drag takes a slow browser seconds, in which the arm goes away under it."""
    grab = partial(ask, visit, visit.click)
    for mode, touch, line, key, shown in (
        ("grab", grab, "on to the next waypoint (grab", "target", "next: {}"),
        ("stroke", visit.click, "slowed (stroke", "speed", "{:.0%} speed"),
    ):
        visit.choose(mode)
        execute(
            visit,
            touch,
            line,
            lambda before, now, key=key: now[key] != before[key],
            lambda state, key=key, shown=shown: shown.format(state[key]),
        )
