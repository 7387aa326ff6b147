"""The whole of `eskin demo`: mouse, page, skin, recogniser, policy, arm, and back."""

import numpy as np
import pytest

pytest.importorskip(
    "playwright.sync_api", reason="no playwright; pip install 'eskin[dev]'"
)
pytest.importorskip("PIL.Image", reason="no pillow; pip install 'eskin[dev]'")

from benchmarks.browser import CHROMIUM, PATIENCE, chromium, new_tab, see
from benchmarks.served_demo import ServedDemo
from benchmarks.visit import Visit, becomes

if not CHROMIUM.exists():
    pytest.skip(f"no {CHROMIUM}; apt-get install chromium", allow_module_level=True)

SEED, PACE, SCALE = 4, 0.5, 0.5
"""Half as fast as life, drawn with a quarter of the points: software draws slowly."""
TRIES = 6
WAIT = 8.0
"""How long a touch may take to be obeyed [s]."""


@pytest.fixture(scope="module")
def visit():
    with ServedDemo(SEED, PACE) as demo, chromium() as browser:
        tab = new_tab(browser, scale=SCALE)
        see(tab, demo.port)
        yield Visit(tab, demo)


def obeyed(visit, touch, line, done):
    """Touch until the arm does it and the page says so; recognition is never sure."""
    for _ in range(TRIES):
        visit.let_go()
        visit.wait_calm()
        if is_obeyed(visit, touch, line, done):
            return
        visit.come_anew()
    pytest.fail(
        f"of {TRIES} touches none led to '{line}'; the arm is {visit.demo.state}, and "
        f"the page says {visit.text()}"
    )


def is_obeyed(visit, touch, line, done):
    before, said = visit.demo.state, visit.text().count(line)
    touch()

    def is_done():
        return done(before, visit.demo.state) and visit.text().count(line) > said

    return becomes(is_done, WAIT)


def moves(visit):
    """Whether the scene changes from one look to another."""
    before = visit.scene()
    return np.abs(visit.scene() - before).max() > 60


def paused(before, now):
    return now["paused"] and not before["paused"]


def resumed(before, now):
    return before["paused"] and not now["paused"]


def test_the_mouse_commands_the_arm_and_the_page_tells(visit):
    q = visit.demo.state["q"]
    assert becomes(lambda: moves(visit), PATIENCE)
    assert not np.allclose(visit.demo.state["q"], q)

    obeyed(visit, visit.click, "pause: poke on forearm", paused)
    assert becomes(lambda: "paused\n" in visit.text(), PATIENCE)
    assert becomes(lambda: not visit.demo.state["moving"], PATIENCE)
    assert becomes(lambda: not moves(visit), PATIENCE)
    q = visit.demo.state["q"]
    visit.demo.wait(1.2 / PACE)
    assert visit.demo.state["q"] == q

    obeyed(visit, visit.click, "resume: poke on forearm", resumed)
    assert becomes(lambda: "running\n" in visit.text(), PATIENCE)
    assert becomes(lambda: moves(visit), PATIENCE)

    obeyed(
        visit,
        visit.double_click,
        "next_waypoint: double_pat on forearm",
        lambda before, now: now["target"] != before["target"],
    )
    assert becomes(lambda: f"to {visit.demo.state['target']}" in visit.text(), PATIENCE)

    obeyed(
        visit,
        visit.drag,
        "slow: stroke on forearm",
        lambda before, now: now["speed"] < before["speed"],
    )
    assert becomes(lambda: "30% speed" in visit.text(), PATIENCE)

    obeyed(
        visit,
        visit.grab,
        "_gripper: grab on forearm",
        lambda before, now: now["gripper"] != before["gripper"],
    )
    assert becomes(
        lambda: f"gripper {visit.demo.state['gripper']}" in visit.text(), WAIT
    )
