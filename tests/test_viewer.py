import os
import signal
import socket
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

from eskin.errors import DeviceError
from eskin.page import ColourScale, PageOrder, TouchOrder
from eskin.page.colours import INVALID_COLOUR
from eskin.page.hand import DOUBLE_CLICK, MIN_SECONDS, MouseHand, SurfacePoint
from eskin.page.port import free_port
from eskin.viewer.appearance import build_link_meshes
from eskin.viewer.process import MAX_IN_FLIGHT, MAX_ORDERS, PageProcess
from eskin.viewer.viewer import describe_arm
from helpers.viewer import mounted, picture, setup

FOREARM = 1200


def wait_until(condition, seconds=20.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "too late"
        time.sleep(0.01)


def luminance(colours):
    """Relative luminance of sRGB colours, WCAG 2.1."""
    share = np.asarray(colours, float) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return linear @ (0.2126, 0.7152, 0.0722)


def as_seen_without(cone, colours):
    """Colours as people without that kind of cone see them (Machado et al. 2009)."""
    share = np.asarray(colours, float) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    matrix = {
        "red": [
            (0.152286, 1.052583, -0.204868),
            (0.114503, 0.786281, 0.099216),
            (-0.003882, -0.048116, 1.051998),
        ],
        "green": [
            (0.367322, 0.860646, -0.227968),
            (0.280085, 0.672501, 0.047413),
            (-0.011820, 0.042940, 0.968881),
        ],
    }[cone]
    seen = np.clip(linear @ np.array(matrix).T, 0, 1)
    return 255 * np.where(
        seen <= 0.0031308, 12.92 * seen, 1.055 * seen ** (1 / 2.4) - 0.055
    )


@pytest.mark.parametrize("cone", [None, "red", "green"])
def test_more_pressure_is_lighter_for_every_kind_of_colour_vision(cone):
    pressure = np.linspace(0.0, 60.0, 500)
    colours = ColourScale(60.0).colours(pressure, np.ones(500, bool))
    light = luminance(colours if cone is None else as_seen_without(cone, colours))
    assert (np.diff(light) > -2e-3).all()
    assert light[-1] - light[0] > 0.6


def test_a_taxel_at_rest_keeps_its_colour_and_one_unheard_has_its_own():
    scale, valid = ColourScale(60.0), np.array([True, True, True, False])
    colours = scale.colours(np.array([0.0, 0.3, 200.0, 40.0]), valid)
    assert np.array_equal(colours[0], colours[1])
    assert np.array_equal(colours[2], scale.table[-1])
    assert tuple(colours[3]) == INVALID_COLOUR


def test_parts_of_the_robot_are_closed_and_their_normals_point_out():
    solids = build_link_meshes(mounted())
    assert len(solids) > 20
    for solid in solids:
        edges = np.concatenate([solid.faces[:, [0, 1]], solid.faces[:, [1, 2]]])
        edges = np.concatenate([edges, solid.faces[:, [2, 0]]])
        there = {tuple(edge) for edge in edges.tolist()}
        assert len(there) == len(edges)
        assert all((b, a) in there for a, b in there)
        a, b, c = solid.vertices[solid.faces].transpose(1, 0, 2)
        assert np.einsum("fi,fi->f", a, np.cross(b, c)).sum() > 0


def test_lids_close_what_is_bare_and_leave_room_for_taxels():
    robot, lids = mounted().robot, {}
    for solid in build_link_meshes(mounted()):
        if solid.colour[2] > solid.colour[0] + 50:
            lids[solid.link] = lids.get(solid.link, 0) + 1
    names = {robot.link_names[link] for link in lids}
    assert {"shoulder_link", "upper_arm_link", "forearm_link"} <= names
    cap = mounted().skin.positions[mounted().skin.find_taxels("wrist_1_cap")]
    low = min(cap[:, 2]) - 0.003
    wrist = robot.link_index("wrist_1_link")
    for solid in build_link_meshes(mounted()):
        if solid.link == wrist:
            assert solid.vertices[:, 2].min() > low


def spot_of(taxel):
    link = int(mounted().taxel_link_index[taxel])
    return SurfacePoint(taxel, link, mounted().skin.positions[taxel])


def test_a_click_pokes_when_no_other_comes_and_two_are_a_double_pat():
    sent = []
    hand = MouseHand(setup(), sent.append)
    hand.click(spot_of(FOREARM), 10.0)
    hand.tick(10.0 + 0.9 * DOUBLE_CLICK)
    assert not sent
    hand.tick(10.0 + DOUBLE_CLICK)
    assert [order.kind for order in sent] == ["poke"]
    hand.click(spot_of(FOREARM), 11.0)
    hand.click(spot_of(FOREARM + 1), 11.0 + 0.9 * DOUBLE_CLICK)
    hand.tick(20.0)
    assert [order.kind for order in sent] == ["poke", "double_pat"]
    hand.click(spot_of(FOREARM), 21.0)
    hand.click(spot_of(FOREARM), 21.0 + DOUBLE_CLICK)
    hand.tick(30.0)
    assert [order.kind for order in sent[2:]] == ["poke", "poke"]
    assert len({order.key for order in sent}) == 4


@pytest.mark.parametrize(("mode", "least"), sorted(MIN_SECONDS.items()))
def test_a_hand_takes_its_time_for_what_takes_time(mode, least):
    sent = []
    hand = MouseHand(setup(), sent.append)
    for hand.seconds in (0.1, 2.0):
        hand.click(spot_of(FOREARM), 0.0, mode.replace("_", "-"))
    assert [order.seconds for order in sent] == [least, 2.0]


@pytest.mark.parametrize("taxel", [0, 400, 800, FOREARM, 1800, 2100])
def test_an_order_carries_the_place_of_its_taxel(taxel):
    sent = []
    hand = MouseHand(setup(), sent.append)
    hand.force, hand.seconds = 13.0, 0.9
    hand.click(spot_of(taxel), 0.0, "grab")
    (order,) = sent
    patch = mounted().skin.patches[mounted().skin.patch_index[taxel]]
    assert (order.kind, order.link) == ("grab", patch.link)
    assert order.p_link == tuple(mounted().skin.positions[taxel].tolist())
    assert (order.force, order.seconds) == (13.0, 0.9)


def test_clicks_far_from_each_other_are_two_pokes_however_fast():
    sent = []
    hand = MouseHand(setup(), sent.append)
    away = int(np.flatnonzero(mounted().taxel_link_index != spot_of(FOREARM).link)[0])
    hand.click(spot_of(FOREARM), 1.0)
    hand.click(spot_of(away), 1.1)
    hand.tick(9.0)
    assert [order.kind for order in sent] == ["poke", "poke"]
    assert sent[0].link != sent[1].link


def test_a_new_drag_lifts_a_finger_that_was_never_lifted():
    sent = []
    hand = MouseHand(setup(), sent.append)
    for taxel in (FOREARM, FOREARM + 1):
        hand.drag("start", spot_of(taxel))
        hand.drag("update", spot_of(taxel + 1))
    assert [order.kind for order in sent] == ["begin", "move", "end", "begin", "move"]
    assert sent[2].key == sent[0].key != sent[3].key


def test_a_drag_begins_moves_and_ends_one_finger():
    sent = []
    hand = MouseHand(setup(), sent.append)
    hand.drag("start", spot_of(FOREARM))
    assert not sent
    hand.drag("update", spot_of(FOREARM + 1))
    hand.drag("update", None)
    hand.drag("end", None)
    assert [order.kind for order in sent] == ["begin", "move", "end"]
    assert len({order.key for order in sent}) == 1
    assert sent[-1].p_link == sent[-2].p_link and sent[-1].link == "forearm_link"
    hand.drag("end", None)
    hand.drag("end", spot_of(FOREARM))
    assert len(sent) == 3


def test_a_drag_that_was_seen_only_where_it_began_and_ended_goes_all_the_way():
    sent = []
    hand = MouseHand(setup(), sent.append)
    hand.drag("start", spot_of(FOREARM))
    hand.drag("end", spot_of(FOREARM + 1))
    assert [order.kind for order in sent] == ["begin", "move", "end"]
    place = spot_of(FOREARM + 1).p_link
    assert sent[0].p_link == tuple(spot_of(FOREARM).p_link.tolist())
    assert sent[1].p_link == sent[2].p_link == tuple(place.tolist())


def test_a_stroke_by_click_runs_over_taxels_of_one_link_and_ends():
    sent = []
    hand = MouseHand(setup(), sent.append)
    hand.click(spot_of(FOREARM), 0.0, "stroke")
    hand.tick(5.0)
    kinds = [order.kind for order in sent]
    assert kinds[0] == "begin" and kinds[-1] == "end"
    assert set(kinds[1:-1]) == {"move"}
    places = np.array([order.p_link for order in sent])
    assert np.linalg.norm(places[-1] - places[0]) > 0.06
    assert {order.link for order in sent} == {"forearm_link"}


class Told:
    moving, paused, hold_reason, speed = True, False, None, 0.5
    gripper, target, protective_stop, connected = "open", "rack", False, True


@pytest.mark.parametrize(
    ("changes", "state", "why"),
    [
        ({}, "running", ""),
        ({"moving": False}, "waiting", ""),
        ({"paused": True}, "paused", ""),
        ({"paused": True, "hold_reason": "stale skin"}, "held", "stale skin"),
        ({"protective_stop": True}, "stopped", "protective stop"),
        ({"connected": False, "paused": True}, "stopped", "lost connection"),
    ],
)
def test_the_gravest_state_of_an_arm_is_the_one_shown(changes, state, why):
    told = Told()
    for name, value in changes.items():
        setattr(told, name, value)
    line = describe_arm(told)
    assert (line.state, line.why) == (state, why)


def test_a_port_that_is_taken_gives_one_clear_line():
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        with pytest.raises(DeviceError, match=f"port {port} of 127.0.0.1") as error:
            PageProcess(setup(), port, None)
        assert "\n" not in str(error.value) and "--port" in str(error.value)
    free_port(port)


@pytest.fixture(scope="module")
def page():
    page = PageProcess(setup(), 0, lambda order: None)
    yield page
    page.close()


def test_a_page_is_served_here_and_nowhere_else(page):
    port = page.wait_ready(60.0)
    with socket.create_connection(("127.0.0.1", port), 5):
        pass
    with pytest.raises(OSError), socket.create_connection(("127.0.0.2", port), 1):
        pass


def test_a_stalled_page_delays_nobody_and_misses_pictures_only(page):
    page.wait_ready(60.0)
    wait_until(lambda: page.wants())
    os.kill(page.process.pid, signal.SIGSTOP)
    try:
        given, longest = page.updates, 0.0
        for index in range(500):
            began = time.monotonic()
            page.give(picture(index * 0.04))
            longest = max(longest, time.monotonic() - began)
        assert page.updates - given == 500
        assert page.in_flight <= MAX_IN_FLIGHT
        assert longest < 1.0
        before = page.shown
    finally:
        os.kill(page.process.pid, signal.SIGCONT)
    wait_until(lambda: page.in_flight == 0 and page.latest is None)
    assert page.shown - before <= MAX_IN_FLIGHT + 1


def test_orders_of_a_page_that_may_not_touch_are_dropped_here_too():
    obeyed = []
    page = PageProcess(setup(touchable=False), 0, obeyed.append)
    try:
        order = TouchOrder("poke", "forearm_link", (0.0, 0.0, 0.1), 5.0, 0.2, 1)
        page.take_order(order)
        page.take_order(PageOrder("kill", 0.1))
        assert page.dropped == 2
    finally:
        page.close()
    assert not obeyed


def test_orders_that_nobody_obeys_in_time_are_dropped_and_counted():
    going, held = threading.Event(), []

    def on_order(order):
        held.append(order)
        going.wait(10.0)

    page = PageProcess(setup(), 0, on_order)
    try:
        for key in range(MAX_ORDERS + 10):
            page.take_order(
                TouchOrder("poke", "base_link", (0.0, 0.0, 0.0), 1.0, 0.1, key)
            )
        assert 9 <= page.dropped <= 10
    finally:
        going.set()
        page.close()


def test_the_process_ends_with_its_parent_even_when_that_is_killed():
    code = (
        "import time\n"
        "from helpers.viewer import setup\n"
        "from eskin.viewer.process import PageProcess\n"
        "page = PageProcess(setup(), 0, None)\n"
        "page.wait_ready(60)\n"
        "print(page.process.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    parent = subprocess.Popen(
        [sys.executable, "-c", code],
        cwd=Path(__file__).parent,
        stdout=subprocess.PIPE,
        text=True,
    )
    with parent:
        child = int(parent.stdout.readline())
        parent.kill()
    wait_until(lambda: not is_alive(child))


def is_alive(pid):
    try:
        with open(f"/proc/{pid}/stat") as file:
            return file.read().rsplit(")", 1)[1].split()[0] != "Z"
    except FileNotFoundError:
        return False
