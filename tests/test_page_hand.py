"""Tests of what the page is made of: colours, the mouse as a hand, and its server."""

import asyncio
from dataclasses import replace
from itertools import combinations
from unittest.mock import MagicMock

import numpy as np
import pytest
from viser import (
    BatchedMeshHandle,
    CameraHandle,
    ClientHandle,
    LabelHandle,
    ViserServer,
)

from eskin.page import ContactMarker, LogEntry
from eskin.page.hand import (
    DOUBLE_CLICK,
    MISSED,
    USUAL,
    MouseHand,
    PaintBrush,
)
from eskin.page.html import GESTURE_COLOURS, choose_gesture_colours
from eskin.page.marks import Marks, TargetMark, measure_box
from eskin.page.scene import FIELD_OF_VIEW, Scene, SurfacePoint
from eskin.skin.colours import INVALID_COLOUR, REST_COLOUR, ColourScale
from eskin.transforms import apply, rotate
from helpers.viewer import make_setup, make_update, mounted

FOREARM = 1200
FAST = 0.9 * DOUBLE_CLICK

VISION = {
    "all cones": np.eye(3),
    "no red": [
        (0.152286, 1.052583, -0.204868),
        (0.114503, 0.786281, 0.099216),
        (-0.003882, -0.048116, 1.051998),
    ],
    "no green": [
        (0.367322, 0.860646, -0.227968),
        (0.280085, 0.672501, 0.047413),
        (-0.011820, 0.042940, 0.968881),
    ],
}
"""How people see linear colours (Machado et al. 2009)."""


@pytest.mark.parametrize("vision", VISION)
def test_luminance_falls_with_pressure_for_every_colour_vision(vision):
    colours = ColourScale(60.0).colours(np.linspace(0.6, 60, 500), np.ones(500, bool))
    luminance = see(colours, vision) @ (0.2126, 0.7152, 0.0722)  # WCAG 2.1.
    assert (np.diff(luminance) < 2e-3).all()
    assert luminance[0] - luminance[-1] > 0.5


def see(colours, vision):
    """Return linear colours as people of a colour vision see them."""
    share = np.asarray(colours, float) / 255
    linear = np.where(share <= 0.04045, share / 12.92, ((share + 0.055) / 1.055) ** 2.4)
    return np.clip(linear @ np.transpose(VISION[vision]), 0, 1)


def compute_lab(colours, vision):
    """Return colours in CIE 1976 L*a*b*, in which people see distances alike."""
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722]]
    to_xyz += [[0.0193, 0.1192, 0.9505]]
    xyz = see(colours, vision) @ np.transpose(to_xyz) / (0.9505, 1.0, 1.089)
    x, y, z = np.where(xyz > 0.008856, np.cbrt(xyz), 7.787 * xyz + 16 / 116).T
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def find_nearest(colours, vision):
    """Return the least distance of two of some colours."""
    lab = compute_lab(colours, vision)
    away = np.linalg.norm(lab[:, None] - lab, axis=-1)
    return away[np.triu_indices(len(lab), 1)].min()


@pytest.mark.parametrize("vision", VISION)
def test_touched_taxels_stand_out_from_those_at_rest_and_not_used(vision):
    table = ColourScale(60.0).table
    for colour in (REST_COLOUR, INVALID_COLOUR):
        lab = compute_lab([colour, *table], vision)
        assert np.linalg.norm(lab[1:] - lab[0], axis=1).min() > 20
    assert find_nearest([REST_COLOUR, INVALID_COLOUR], vision) > 20


@pytest.mark.parametrize("vision", VISION)
def test_gestures_are_told_apart_by_their_colours(vision):
    own = choose_gesture_colours(["wave", "knock"])
    colours = [tuple(bytes.fromhex(colour[1:])) for colour in own.values()]
    assert find_nearest(colours, vision) > 10


def test_gesture_keeps_its_colour_beside_any_others():
    assert choose_gesture_colours(["poke", "b"])["poke"] == GESTURE_COLOURS["poke"]
    one, other = (choose_gesture_colours(names) for names in (["a", "b"], ["b", "a"]))
    assert one == other
    assert len(choose_gesture_colours(map(str, range(40)))) == 40 + len(GESTURE_COLOURS)


def test_resting_and_invalid_taxels_have_their_own_colours():
    scale = ColourScale(60.0)
    valid = np.array([True, True, True, False])
    colours = scale.colours(np.array([0.0, 0.3, 200.0, 40.0]), valid)
    assert np.array_equal(colours[0], colours[1]) and tuple(colours[0]) == REST_COLOUR
    assert np.array_equal(colours[2], scale.table[-1])
    assert tuple(colours[3]) == INVALID_COLOUR


def point(taxel=FOREARM):
    """Return the centre of a taxel."""
    link = int(mounted().taxel_link_index[taxel])
    return SurfacePoint(taxel, link, mounted().skin.positions[taxel])


@pytest.fixture
def hand():
    """A hand that keeps its orders in `sent`, and its answers in `told`."""
    sent = []
    hand = MouseHand(make_setup(), sent.append)
    hand.sent = sent
    hand.told = []
    hand.tell = hand.told.append
    return hand


def kinds(hand):
    return [order.kind for order in hand.sent]


def test_click_pokes_when_no_other_follows(hand):
    hand.click(point(), 10.0)
    hand.tick(10.0 + FAST)
    assert not hand.sent
    hand.tick(10.0 + DOUBLE_CLICK)
    assert kinds(hand) == ["poke"]


OTHER_LINK = int(np.flatnonzero(mounted().taxel_link_index != point().link)[0])


@pytest.mark.parametrize(
    ("second", "delay", "expected"),
    [
        (FOREARM + 1, FAST, ["double_pat"]),
        (FOREARM, DOUBLE_CLICK, ["poke", "poke"]),
        (OTHER_LINK, 0.1, ["poke", "poke"]),
    ],
)
def test_two_clicks_near_and_fast_are_double_pat(hand, second, delay, expected):
    hand.click(point(), 1.0)
    hand.click(point(second), 1.0 + delay)
    hand.tick(9.0)
    assert kinds(hand) == expected
    assert len({order.key for order in hand.sent}) == len(expected)
    assert hand.sent[-1].link == mounted().robot.link_names[point(second).link]


@pytest.mark.parametrize("misses", [(0,), (1,)])
def test_double_click_of_which_one_hits_is_double_pat(hand, misses):
    for number in range(2):
        hand.click(None if number in misses else point(), 1.0 + FAST * number)
    hand.tick(9.0)
    assert kinds(hand) == ["double_pat"]


@pytest.mark.parametrize("clicks", [1, 2])
@pytest.mark.parametrize("mode", ["poke", "grab"])
def test_click_beside_the_skin_is_answered_and_touches_nothing(hand, clicks, mode):
    for number in range(clicks):
        hand.click(None, 1.0 + FAST * number, mode)
    hand.tick(9.0)
    assert not hand.sent and set(hand.told) == {MISSED}


@pytest.mark.parametrize(
    ("answer", "mode", "expected"),
    [
        ("poke", None, ["poke", "poke"]),
        ("poke", "grab", ["grab", "grab"]),
        ("double pat", None, ["double_pat", "double_pat"]),
    ],
)
def test_click_answers_a_question_at_once(hand, answer, mode, expected):
    hand.mode = "stroke"
    hand.answer = answer
    for number in range(2):
        hand.click(point(), 1.0 + FAST * number, mode)
    assert kinds(hand) == expected
    hand.mode = "poke"
    hand.answer = None
    hand.click(point(), 10.0)
    assert kinds(hand) == expected


def test_every_touch_is_answered_with_its_patch(hand):
    for number, mode in enumerate(("poke", "double pat", "grab", "stroke")):
        hand.click(point(), 10.0 * number, mode)
        hand.tick(10.0 * number + 9.0)
    hand.drag("start", point())
    hand.drag("end", point(FOREARM + 1))
    words = [text.split(" on ")[0] for text in hand.told]
    touches = ["poke", "double pat", "grab", "stroke", "finger"]
    assert words == [f"your {touch}" for touch in touches]
    patch = mounted().skin.patches[mounted().skin.patch_index[FOREARM]].id
    assert all(patch.replace("_", " ") in text for text in hand.told)


@pytest.mark.parametrize("kind", ["poke", "double_pat", "grab"])
def test_touch_is_the_usual_one_times_what_is_chosen(hand, kind):
    hand.firmness = 0.5
    hand.slowness = 2.0
    hand.click(point(), 0.0, kind.replace("_", " "))
    hand.tick(5.0)
    (order,) = hand.sent
    force, seconds = USUAL[kind]
    assert (order.force, order.seconds) == (0.5 * force, 2.0 * seconds)


@pytest.mark.parametrize("taxel", [0, 800, FOREARM, 2100])
def test_order_has_place(hand, taxel):
    hand.click(point(taxel), 0.0, "grab")
    (order,) = hand.sent
    patch = mounted().skin.patches[mounted().skin.patch_index[taxel]]
    assert (order.kind, order.link) == ("grab", patch.link)
    assert order.p_link == tuple(mounted().skin.positions[taxel].tolist())


@pytest.mark.parametrize(
    ("phases", "expected"),
    [
        (["start"], []),
        (["start", "update", "off", "end off"], ["begin", "move", "end"]),
        (["start", "end"], ["begin", "move", "end"]),
        (["end off", "end"], []),
        (
            ["start", "update", "start", "update"],
            ["begin", "move", "end", "begin", "move"],
        ),
    ],
)
def test_drag_moves_one_finger(hand, phases, expected):
    for number, phase in enumerate(phases):
        spot = None if "off" in phase else point(FOREARM + number)
        hand.drag(phase.removesuffix("off").strip() or "update", spot)
    assert kinds(hand) == expected
    fingers = expected.count("begin")
    assert len({order.key for order in hand.sent}) == fingers
    if fingers == 1:
        first, last = point(FOREARM).p_link, point(FOREARM + 1).p_link
        assert hand.sent[0].p_link == tuple(first.tolist())
        assert hand.sent[1].p_link == hand.sent[2].p_link == tuple(last.tolist())


def test_stroke_by_click_runs_along_one_link(hand):
    hand.click(point(), 0.0, "stroke")
    hand.tick(5.0)
    first, *between, last = kinds(hand)
    assert (first, set(between), last) == ("begin", {"move"}, "end")
    places = np.array([order.p_link for order in hand.sent])
    assert np.linalg.norm(places[-1] - places[0]) > 0.06
    assert {order.link for order in hand.sent} == {"forearm_link"}


def test_drag_paints_balls_of_one_stroke_as_far_apart_as_the_brush_wants():
    sent = []
    brush = PaintBrush(make_setup(), sent.append)
    brush.radius = 0.03
    start = point()
    brush.drag("start", start)
    assert sent == []
    for step in range(30):
        moved = start.p_link + np.array([0.0, 0.0, 0.004 * step])
        brush.drag("update", SurfacePoint(FOREARM, start.link, moved))
    brush.drag("update", None)
    brush.drag("end", None)
    places = np.array([ball.p_link for ball in sent])
    assert {ball.stroke for ball in sent} == {1}
    assert np.linalg.norm(np.diff(places, axis=0), axis=1).min() >= 0.015
    # No point of the drag is left without paint.
    assert np.linalg.norm(places[:, None] - moved, axis=2).min() < 0.03
    brush.keeps_out = True
    brush.click(start, 0.0)
    assert (sent[-1].stroke, sent[-1].keeps_out) == (2, True)
    brush.matrix = (16, 16, 0.006)
    for phase in ("start", "update", "end"):
        brush.drag(phase, start)
    assert (len(sent), sent[-1].matrix) == (len(places) + 2, brush.matrix)


def test_disc_is_of_the_size_of_its_taxel_before_it_is_scaled():
    """A copy of the mesh that is not scaled takes clicks: viser's outline."""
    server = MagicMock(ViserServer, scene=MagicMock())
    add = server.scene.add_batched_meshes_simple
    add.return_value = MagicMock(BatchedMeshHandle)
    scene = Scene(server, make_setup(), ColourScale(60.0))
    for link in scene.discs:
        scene.add_pads(link)
    widest = 2 * np.sqrt(mounted().skin.areas.max() / np.pi)
    for call in add.call_args_list:
        assert np.linalg.norm(call.args[1], axis=1).max() < widest
        assert 0.5 < call.kwargs["batched_scales"].max() < 1.01


def make_scene():
    """Return a scene whose server keeps labels and draws nothing."""
    server = MagicMock(ViserServer, scene=MagicMock())
    server.scene.add_batched_meshes_simple.return_value = MagicMock(BatchedMeshHandle)
    server.scene.add_label.side_effect = lambda name, text, **given: MagicMock(
        LabelHandle, text=text, visible=given.get("visible", True)
    )
    scene = Scene(server, make_setup(), ColourScale(60.0))
    scene.face_skin()
    return scene


def test_camera_turns_anew_when_a_window_becomes_narrow():
    scene = make_scene()
    client = MagicMock(ClientHandle, camera=MagicMock(CameraHandle))
    distances = []
    asyncio.run(scene.watch(client))
    tell = client.camera.on_update.call_args.args[0]
    for client.camera.aspect in (2.0, 0.5, 0.4, 1.5):
        client.camera.position = np.zeros(3)
        asyncio.run(tell(client.camera))
        distances.append(float(np.linalg.norm(client.camera.position)))
    first, narrow, again, wide = distances
    assert narrow > 1.5 * first and wide == first > again == 0


def test_place_where_to_click_is_seen_in_every_pose():
    """No other taxel is drawn before it, and it faces the camera."""
    scene = make_scene()
    rng = np.random.default_rng(0)
    target = TargetMark(scene.server, scene, hints=True)
    for turn in np.linspace(-3.0, 3.0, 12):
        bend = rng.uniform((-2.2, 0.6, -2.2), (-1.0, 2.2, -0.6))
        q = np.array([turn, *bend, -1.5, 0.0])
        scene.T_world_link = mounted().kinematics.poses(q)
        place = target.find_hint()
        T = scene.T_world_link[place.link]
        at = apply(T, np.array(place.p_link))
        to = rotate(T, np.array(place.n_link))
        ray = target.eye - at
        ray /= np.linalg.norm(ray)
        away = scene.place_taxels()[0] - at
        along = away @ ray
        aside = np.linalg.norm(away - along[:, None] * ray, axis=1)
        assert ray @ to > 0.59 and not np.any((along > 0.08) & (aside < 0.01))


def test_scene_is_projected_as_the_camera_shows_it():
    scene = make_scene()
    eye, middle = scene.view
    assert scene.project(middle) == pytest.approx([0, 0])
    up = np.cross(np.cross(middle - eye, (0, 0, 1)), middle - eye)
    up /= np.linalg.norm(up)
    # The upper edge of the picture is half a field of view above its middle.
    edge = np.tan(FIELD_OF_VIEW / 2) * np.linalg.norm(middle - eye) * up
    half = scene.picture_height / 2
    assert scene.project(middle + edge) == pytest.approx([0, -half])
    right = np.cross(middle - eye, up)
    across, down = scene.project(middle + 0.1 * right)
    assert across > 0 and abs(down) < 1e-9


def test_labels_of_forces_overlap_no_other_label():
    scene = make_scene()
    rng = np.random.default_rng(3)
    shown = []
    marks = Marks(scene.server, scene)
    setup = scene.setup
    for number in range(60):
        taxels = rng.choice(len(setup.positions), 3)
        contacts = tuple(
            ContactMarker(
                int(setup.taxel_link[taxel]),
                setup.positions[taxel],
                setup.normals[taxel],
                0.01,
                force,
                setup.patches[setup.patch_index[taxel]],
            )
            for taxel, force in zip(taxels, (9.0, 6.0, 2.0), strict=True)
        )
        found = contacts[0]
        place = tuple(map(float, found.p_link))
        entry = LogEntry(
            3.0 * number,
            "detection",
            "poke 98%, 9 N",
            "poke",
            found.link,
            place,
            1,
            "poke 98%",
        )
        entries = (entry,) if number % 2 else ()
        update = make_update(3.0 * number, log_entries=entries)
        scene.update(update)
        marks.update(replace(update, contacts=contacts))
        boxes = [marks.measure_label(label) for label in marks.labels]
        boxes += [
            measure_box(scene.project(label.position), label.text)
            for label in marks.names
            if label.visible
        ]
        for one, other in combinations(boxes, 2):
            apart = np.maximum(one[:2] - other[2:], other[:2] - one[2:])
            assert apart.max() >= 0
        assert marks.names[0].visible or entries
        shown.append(len(boxes))
    assert max(shown) == 4 and min(shown) < 3
