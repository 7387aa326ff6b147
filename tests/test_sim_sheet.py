"""These tests check touches on skins of any shape, against shapes that are known."""

import json
from dataclasses import replace

import numpy as np
import pytest

from eskin.cli.main import run
from eskin.recording import find_recordings, read_recording
from eskin.robot import load_robot, load_urdf
from eskin.robot.shapes import build_geom_mesh
from eskin.sim import build_charts, load_constants
from eskin.sim.contact.chart import build_sheet_charts
from eskin.sim.contact.pressure import compute_pressure_field
from eskin.sim.contact.sheet import build_sheet, build_skin_mesh
from eskin.sim.interactive import InteractiveSkin, LinkPoint
from eskin.sim.scene import find_untouched_links, load_environment
from eskin.sim.scene.collision import build_cylinders
from eskin.sim.scene.targets import CLOSE, find_allowed
from eskin.skin import (
    Dome,
    MountedSkin,
    Patch,
    Skin,
    TaxelGrid,
    Tube,
    build_skin,
    save_skin,
)
from helpers.contacts import FINGERS, TIP, press

CONSTANTS = load_constants()
PITCH = 0.008
RIM = 0.012


def lay(*surfaces, rows=24, columns=14):
    """Lay a patch on each surface, on the forearm of a UR5."""
    grid = TaxelGrid(rows, columns, PITCH, PITCH)
    placed = [
        (Patch(f"p{i}", "forearm_link", i + 1, rows, columns), grid, surface)
        for i, surface in enumerate(surfaces)
    ]
    return MountedSkin(build_skin("made", placed), load_robot("ur5"))


def turn_tube(radius, angle):
    pose = np.eye(4)
    cosine = np.cos(angle)
    sine = np.sin(angle)
    pose[:2, :2] = [[cosine, -sine], [sine, cosine]]
    return Tube(radius, pose)


TUBE = lay(*(turn_tube(0.04, angle) for angle in (0.0, np.pi)))
DOME = lay(Dome(0.12, np.eye(4)), columns=24)


@pytest.mark.parametrize(
    ("mounted", "curvatures"), [(TUBE, (0.0, 25.0)), (DOME, (1 / 0.12, 1 / 0.12))]
)
def test_curvature_of_the_mesh_is_that_of_the_shape(mounted, curvatures):
    for number in range(len(mounted.skin.patches)):
        own = np.flatnonzero(mounted.skin.patch_index == number)
        sheet, _ = build_sheet(build_skin_mesh(mounted.skin), own)
        found = np.linalg.eigvalsh(sheet.curvatures).mean(axis=0)
        assert found == pytest.approx(curvatures, abs=0.3)


def test_places_between_taxels_map_both_ways_and_lie_on_the_shape():
    rng = np.random.default_rng(0)
    for mounted, radius, axes in ((TUBE, 0.04, 2), (DOME, 0.12, 3)):
        chart = build_sheet_charts(mounted, RIM)[0]
        own = chart.unrolled[chart.own]
        places = own[rng.integers(len(own), size=300)]
        places = places + rng.uniform(-PITCH / 2, PITCH / 2, places.shape)
        points = chart.surface.wrap(places)
        away = np.linalg.norm(points.positions[:, :axes], axis=1)
        assert away == pytest.approx(radius, abs=5e-5)
        outward = points.positions[:, :axes] / away[:, None]
        assert np.sum(outward * points.normals[:, :axes], axis=1).min() > 0.999
        back = chart.surface.unroll(points.positions)
        assert back == pytest.approx(places, abs=3e-4)
        assert np.abs(np.sum(points.tangents * points.normals, axis=1)).max() < 1e-9


@pytest.mark.parametrize("pads", [TIP, FINGERS], ids=["tip", "fingers"])
def test_contact_on_a_sheet_is_that_on_the_tube_under_it(pads):
    [tube] = build_charts(TUBE, RIM)
    sheet, _ = build_sheet_charts(TUBE, RIM)
    taxel = sheet.own[np.argmin(np.linalg.norm(sheet.unrolled[sheet.own], axis=1))]
    at = np.searchsorted(tube.taxels, sheet.taxels[taxel])
    steps = sheet.unrolled[taxel] + [[0.0, 0.0], [0.0, 1e-4]]
    heights = sheet.surface.wrap(steps).positions[:, 2]
    flip = 0.0 if heights[1] > heights[0] else np.pi
    touches = [
        press(pads, [2.0, 20.0], tuple(tube.unrolled[at]), 0.4),
        press(pads, [2.0, 20.0], tuple(sheet.unrolled[taxel]), 0.4 + flip),
    ]
    one, other = (
        compute_pressure_field(touch, chart, CONSTANTS)
        for touch, chart in zip(touches, (tube, sheet), strict=True)
    )
    assert other.area == pytest.approx(one.area, rel=0.05)
    felt = np.zeros((2, 2, TUBE.skin.count))
    felt[0][:, one.taxels] = one.pressure
    felt[1][:, other.taxels] = other.pressure
    assert felt[1].sum() == pytest.approx(felt[0].sum(), rel=0.03)
    assert np.abs(felt[1] - felt[0]).max() < 0.1 * felt[0].max()


def make_bumpy(seed=0):
    """Lay three patches beside each other on a plane with waves."""
    places = np.stack(np.meshgrid(np.arange(24), np.arange(16)), axis=-1)
    places = PITCH * places.reshape(-1, 2).astype(float)
    rows, columns = np.divmod(np.arange(len(places)), 24)
    x, y = places.T
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(25.0, 35.0, 2)
    height = 0.008 * np.sin(a * x) * np.cos(b * y)
    slopes = 0.008 * np.column_stack(
        [a * np.cos(a * x) * np.cos(b * y), -b * np.sin(a * x) * np.sin(b * y)]
    )
    normals = np.column_stack([-slopes, np.ones(len(x))])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    tangents = np.column_stack([np.ones(len(x)), np.zeros(len(x)), slopes[:, 0]])
    tangents -= np.sum(tangents * normals, axis=1, keepdims=True) * normals
    tangents /= np.linalg.norm(tangents, axis=1, keepdims=True)
    return Skin(
        name="bumpy",
        patches=tuple(Patch(f"p{i}", "body", i + 1, 16, 8) for i in range(3)),
        patch_index=columns // 8,
        rows=rows,
        columns=columns % 8,
        positions=np.column_stack([x - x.mean(), y - y.mean(), height + 0.055]),
        normals=normals,
        areas=PITCH**2 / normals[:, 2],
        tangents=tangents,
    )


BODY = """<robot name="block">
<link name="body"><collision><geometry><box size="0.5 0.4 0.09"/></geometry>
</collision></link>
<link name="mast"><collision><geometry><box size="0.1 0.1 0.1"/></geometry>
</collision></link>
<joint name="lift" type="revolute"><parent link="body"/><child link="mast"/>
  <origin xyz="0 0 2.2"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""


@pytest.fixture(scope="module")
def bumpy(tmp_path_factory):
    """Return the folder of a skin with waves, and the URDF of its robot."""
    folder = tmp_path_factory.mktemp("bumpy")
    (folder / "block.urdf").write_text(BODY)
    save_skin(make_bumpy(), folder / "skin")
    return str(folder / "skin"), str(folder / "block.urdf")


@pytest.fixture(scope="module")
def world(bumpy):
    return load_environment(*bumpy)


def test_every_taxel_is_the_own_one_of_one_chart_and_of_others_too(world):
    own = np.concatenate([chart.taxels[chart.own] for chart in world.charts])
    assert np.array_equal(np.sort(own), np.arange(world.mounted.skin.count))
    # A hand near the edge of a patch reaches the next one.
    assert all(len(chart.own) < len(chart.taxels) for chart in world.charts)


def test_force_on_any_place_of_a_bumpy_skin_is_borne_by_its_taxels(world):
    skin = world.mounted.skin
    constants = world.constants
    for number, chart in enumerate(world.charts):
        middle = np.argmin(np.linalg.norm(chart.unrolled[chart.own], axis=1))
        # A whole hand has room on the middle one of three patches.
        for pads in (TIP, FINGERS)[: 1 + (number == 1)]:
            touch = press(pads, [3.0, 15.0], tuple(chart.unrolled[chart.own[middle]]))
            felt = compute_pressure_field(touch, chart, constants)
            force = 1e3 * felt.pressure @ skin.areas[felt.taxels]
            assert force == pytest.approx([3.0, 15.0], rel=0.15)


def test_same_touch_from_two_charts_is_felt_alike(world):
    """A place on the seam of two patches lies on the charts of both."""
    skin = world.mounted.skin
    seam = np.flatnonzero((skin.columns == 7) & (skin.rows == 8))[0]
    felt = np.zeros((2, skin.count))
    for number, chart in enumerate(world.charts[:2]):
        at = np.flatnonzero(chart.taxels == seam)[0]
        # The hand points along the columns of the patch, whichever way t runs.
        along, _ = chart.cells[at]
        angle = float(np.arctan2(-along[0], along[1]))
        touch = press(FINGERS, 10.0, tuple(chart.unrolled[at]), angle)
        found = compute_pressure_field(touch, chart, world.constants)
        felt[number, found.taxels] = found.pressure[0]
    assert felt[1].sum() == pytest.approx(felt[0].sum(), rel=0.03)
    assert np.array(np.corrcoef(felt))[0, 1] > 0.98


def test_robot_that_is_moved_has_the_same_sheets():
    skin = make_bumpy()
    rotation = np.linalg.qr(np.random.default_rng(3).normal(size=(3, 3)))[0]
    rotation *= np.linalg.det(rotation)
    moved = replace(
        skin,
        positions=skin.positions @ rotation.T + [0.3, -0.2, 0.1],
        normals=skin.normals @ rotation.T,
        tangents=skin.tangents @ rotation.T,
    )
    own = np.flatnonzero(skin.patch_index == 1)
    (one, taxels), (other, same) = (
        build_sheet(build_skin_mesh(each), own) for each in (skin, moved)
    )
    assert np.array_equal(taxels, same)
    lengths = [np.linalg.norm(each.flat, axis=1) for each in (one, other)]
    assert lengths[1] == pytest.approx(lengths[0], abs=1e-9)
    bent = [np.linalg.eigvalsh(each.curvatures) for each in (one, other)]
    assert bent[1] == pytest.approx(bent[0], abs=1e-6)


def test_hand_closes_round_a_limb_and_not_round_a_body(world):
    limb = build_sheet_charts(TUBE, RIM)
    assert {find_allowed(chart, CONSTANTS) for chart in limb} == {CLOSE}
    assert max(world.targets.allows) < CLOSE


def test_grab_where_no_hand_closes_is_a_pressing_hand(bumpy):
    skin = InteractiveSkin(bumpy[0], loses=False, robot=bumpy[1])
    place = LinkPoint("body", skin.mounted.skin.positions[200])
    skin.hand.grab(place)
    assert [touch.touch.gesture for touch in skin.hand.active.values()] == ["none"]


def test_cylinders_enclose_every_shape(tmp_path):
    path = tmp_path / "block.urdf"
    path.write_text(BODY.replace('<box size="0.1 0.1 0.1"/>', '<sphere radius="0.1"/>'))
    robot = load_urdf(path)
    found = build_cylinders(robot)
    for index, link in enumerate(robot.links):
        points = build_geom_mesh(link.geoms[0]).vertices
        inside = np.zeros(len(points), dtype=bool)
        for i in np.flatnonzero(found.links == index):
            away = points - found.centres[i]
            along = away @ found.axes[i]
            out = np.linalg.norm(away - along[:, None] * found.axes[i], axis=1)
            inside |= (np.abs(along) <= found.half_lengths[i] + 1e-9) & (
                out <= found.radii[i] + 1e-9
            )
        assert inside.all()


def test_link_out_of_reach_is_named(bumpy, tmp_path):
    skin = make_bumpy()
    high = replace(
        skin,
        patches=tuple(
            replace(patch, link="mast" if number == 2 else "body")
            for number, patch in enumerate(skin.patches)
        ),
    )
    save_skin(high, tmp_path / "high")
    env = load_environment(str(tmp_path / "high"), bumpy[1])
    assert find_untouched_links(env) == ("mast",)


def test_set_is_generated_on_a_designed_skin_and_read_with_its_robot(
    bumpy, tmp_path, capsys
):
    command = ["generate", str(tmp_path / "set"), "--skin", bumpy[0], "--robot-urdf"]
    options = ["--set", "val", "--clips", "4", "--workers", "1", "--json"]
    assert run([*command, bumpy[1], *options]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["clips"] == 4
    recordings = [read_recording(p) for p in find_recordings([tmp_path / "set"])]
    for recording in recordings:
        assert recording.skin.name == "bumpy"
        assert recording.load_robot().name == "block"
        assert "grab" not in {label.gesture for label in recording.labels}
    settings = json.loads((tmp_path / "set" / "generation.json").read_text())
    assert settings["robot"] == bumpy[1] and len(settings["skin_digest"]) == 64


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--skin", "SKIN"], ["without a robot", "--robot-urdf"]),
        (["--skin", "SKIN", "--robot-urdf", "ur5"], ["links", "body"]),
        (["--skin", "nowhere"], ["no skin 'nowhere'"]),
        (["--skin", "sleeve"], ["--skin is 'sleeve'", "ur5-half"]),
        (["--skin", "SKIN", "--robot-urdf", "URDF", "--set", "pairs"], ["pairs"]),
    ],
)
def test_skin_that_cannot_be_simulated_is_refused_in_one_line(
    bumpy, tmp_path, capsys, options, words
):
    named = {"SKIN": bumpy[0], "URDF": bumpy[1]}
    out = tmp_path / "set"
    words_given = [named.get(word, word) for word in options]
    assert run(["generate", str(out), *words_given, "--clips", "4"]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    for word in words:
        assert word in error
    assert not out.exists()
