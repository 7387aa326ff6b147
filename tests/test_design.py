"""Tests of skin design: what holds of every design, and what is refused."""

import csv
import json
import re
from dataclasses import replace
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from eskin.cli.main import run
from eskin.design.commands.paint import SpecDraft
from eskin.errors import RobotError, SkinError
from eskin.page import PaintOrder
from eskin.robot import compute_surface_distance, load_robot, load_urdf
from eskin.skin import check_skin, load_skin
from helpers.cli import assert_refused, call, call_json

igl = pytest.importorskip("igl", reason="libigl is not installed: extra design")
for package in ("manifold3d", "embreex", "ezdxf", "shapely"):
    pytest.importorskip(package, reason=f"{package} is not installed: extra design")

import trimesh  # noqa: E402
from shapely import LineString, Polygon  # noqa: E402

from eskin.design import (  # noqa: E402
    BallZone,
    BoxZone,
    DesignLimits,
    DesignSpec,
    LinkZone,
    RegionSpec,
    SurfaceDistance,
    build_link_surface,
    design_skin,
    draw_design,
    load_map,
    read_spec,
    save_design,
)
from eskin.design.painting import PaintedBall, add_painted, find_points, sample_surfaces  # noqa: E402
from eskin.design.patches import divide, iterate_routable  # noqa: E402
from eskin.design.spec import RegionEntry, SpecFile, write_spec_file  # noqa: E402
from eskin.skin import MountedSkin  # noqa: E402

pytestmark = pytest.mark.slow

SHAPES = {
    "tube": '<cylinder radius="0.04" length="0.2"/>',
    "ball": '<sphere radius="0.05"/>',
    "box": '<box size="0.08 0.1 0.12"/>',
    "torus": '<mesh filename="torus.stl"/>',
}
DENSITY = 1.2e4
PITCH = DENSITY**-0.5
MM = 1e-3


def write_urdf(folder, shape, name="toy"):
    """Write a robot of one link."""
    path = folder / f"{name}.urdf"
    path.write_text(
        f'<robot name="{name}"><link name="body"><collision><geometry>{shape}'
        "</geometry></collision></link></robot>"
    )
    return path


def write_mesh(folder, mesh, name="mesh.stl"):
    mesh.export(folder / name)
    return write_urdf(folder, f'<mesh filename="{name}"/>')


def make_spec(density=DENSITY, zone=None, keep_outs=(), **limits):
    zone = zone or LinkZone("body")
    regions = (RegionSpec(zone, density),)
    return DesignSpec("toy", regions, tuple(keep_outs), DesignLimits(**limits))


@pytest.fixture(scope="module")
def robots(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shapes")
    trimesh.creation.torus(0.06, 0.03, 48, 20).export(folder / "torus.stl")
    return {
        name: load_urdf(write_urdf(folder, shape, name))
        for name, shape in SHAPES.items()
    }


@pytest.fixture(scope="module")
def designs(robots):
    """A design of each shape."""
    return {name: design_skin(robot, make_spec()) for name, robot in robots.items()}


def find_neighbours(grid):
    """Return pairs of taxels that are next to each other in a row or a column."""
    rows, columns = grid.cells()
    places = {cell: i for i, cell in enumerate(zip(rows, columns, strict=True))}
    return np.array(
        [
            (i, places[r + dr, c + dc])
            for (r, c), i in places.items()
            for dr, dc in ((0, 1), (1, 0))
            if (r + dr, c + dc) in places
        ]
    )


def sample_cells(layout, size=0.9):
    """Return points of the link all over the cells of a patch."""
    steps = size * layout.grid.column_pitch * np.linspace(-0.5, 0.5, 4)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    flat = layout.grid.unrolled()[:, None] + offsets
    return layout.surface.wrap(flat.reshape(-1, 2)).positions


def count_overlapping(layout, points):
    """Count points of the link that lie in a cell of a patch."""
    flat = layout.surface.unroll(points)
    back = layout.surface.wrap(flat).positions
    on_surface = np.linalg.norm(back - points, axis=1) < 1e-7
    away = np.abs(flat[:, None] - layout.grid.unrolled()[None]).max(axis=2)
    inside = away.min(axis=1) < 0.49 * layout.grid.column_pitch
    return int(np.count_nonzero(on_surface & inside))


@pytest.mark.parametrize("name", SHAPES)
def test_taxels_lie_on_the_surface_as_densely_as_asked(robots, designs, name):
    design = designs[name]
    distances, _ = compute_surface_distance(
        robots[name].links[0], design.skin.positions
    )
    assert np.abs(distances).max() < 0.2 * MM
    assert check_skin(design.skin, robots[name]) == []
    for number, layout in enumerate(design.layouts):
        areas = design.skin.areas[design.skin.patch_index == number]
        assert len(areas) / areas.sum() == pytest.approx(DENSITY, rel=0.1)
        assert layout.distortion <= design.spec.limits.max_distortion
        assert layout.grid.rows <= 16 and layout.grid.columns <= 16
        assert len(areas) >= design.spec.limits.min_taxels


@pytest.mark.parametrize("name", SHAPES)
def test_unrolled_and_surface_distances_of_neighbours_agree(robots, designs, name):
    """To the distortion that is stated, by exact paths on the mesh."""
    design = designs[name]
    surface = build_link_surface(robots[name].links[0])
    number = max(range(len(design.layouts)), key=lambda i: design.layouts[i].distortion)
    layout = design.layouts[number]
    taxels = design.skin.find_taxels(design.skin.patches[number].id)
    pairs = find_neighbours(layout.grid)[:: len(taxels) // 6]
    points = design.skin.positions[taxels]
    distance = SurfaceDistance(surface, points)
    for i, j in pairs:
        length = distance.between(np.array([i]), np.array([j]))[0, 0]
        # A tube's taxels lie on the cylinder, up to 0.02 mm outside of its mesh.
        assert length == pytest.approx(PITCH, rel=layout.distortion + 5e-3)


@pytest.mark.parametrize("name", SHAPES)
def test_patches_do_not_overlap(designs, name):
    layouts = designs[name].layouts
    for first, second in combinations(layouts, 2):
        assert count_overlapping(second, sample_cells(first)) == 0


def test_overlap_of_a_patch_with_itself_is_found(designs):
    layout = designs["ball"].layouts[0]
    assert count_overlapping(layout, sample_cells(layout)) > 0


@pytest.mark.parametrize("seed", range(2))
def test_keep_outs_hold_no_part_of_a_cell(robots, seed):
    rng = np.random.default_rng(seed)
    zones = [
        BoxZone("body", (-1.0, -1.0, 0.02), (1.0, 1.0, 0.05)),
        BallZone("body", tuple(0.05 * rng.normal(size=3)), 0.02),
    ]
    design = design_skin(robots["box"], make_spec(keep_outs=zones), seed)
    for layout in design.layouts:
        points = sample_cells(layout)
        assert not any(zone.contains(points).any() for zone in zones)


def test_region_covers_only_its_part_at_its_density(robots):
    part = BallZone("body", (0.04, 0.0, 0.0), 0.05)
    regions = (RegionSpec(part, 3e4), RegionSpec(LinkZone("body"), 1e4))
    design = design_skin(robots["box"], DesignSpec("toy", regions))
    dense, rest = design.regions
    in_part = np.isin(design.skin.patch_index, dense.patches)
    assert in_part.sum() > 30
    np.testing.assert_array_equal(part.contains(design.skin.positions), in_part)
    assert rest.area + dense.area == pytest.approx(0.0592, rel=1e-6)


def test_painted_region_is_read_back_and_covered(robots, tmp_path):
    """Balls that overlap are one region: no patch ends where two of them meet."""
    heights = (-0.03, 0.0, 0.03)
    balls = [PaintedBall("body", (0.04, 0.0, z), 0.03, False) for z in heights]
    gap = PaintedBall("body", (0.04, 0.0, 0.0), 0.012, True)
    earlier = SpecFile(regions=[RegionEntry(link="body", density_per_cm2=0.5)])
    entries = add_painted(earlier, [*balls, gap], 3e4)
    write_spec_file(tmp_path / "spec.yaml", entries)
    regions, keep_outs = read_spec(tmp_path / "spec.yaml", DENSITY)
    assert [region.density for region in regions] == pytest.approx([3e4, 5e3])
    skin = sample_surfaces(robots["box"])
    for zones, painted in (([regions[0].zone], balls), (keep_outs, [gap])):
        away = np.array([skin.positions - ball.point for ball in painted])
        radii = np.array([ball.radius for ball in painted])
        near = np.linalg.norm(away, axis=2) <= radii[:, None]
        assert (find_points(skin, zones) == near.any(axis=0)).all()
    design = design_skin(robots["box"], DesignSpec("toy", regions, keep_outs))
    on_paint = np.isin(design.skin.patch_index, design.regions[0].patches)
    places = design.skin.positions[on_paint]
    assert regions[0].zone.contains(places).all() and len(places) > 60
    assert not keep_outs[0].contains(design.skin.positions).any()


def test_saving_again_replaces_what_was_painted_and_keeps_what_was_there(
    robots, tmp_path
):
    before = SpecFile(regions=[RegionEntry(link="foot")])
    spec = tmp_path / "spec.yaml"
    folder = tmp_path / "skin"
    draft = SpecDraft(spec, before, 0.5, robots["box"], folder)
    places = [(0.0, 0.0, 0.1 * n) for n in range(3)]
    orders = [PaintOrder(n, "body", p, 0.03, False) for n, p in enumerate(places)]
    for count in (3, 1):
        assert draft.save(tuple(orders[:count])) == f"saved: {draft.path}"
        assert read_spec(draft.path, DENSITY) == draft.written.build(DENSITY)
        painted, kept = draft.written.regions
        assert (painted.link, painted.density_per_cm2) == ("body", 0.5)
        assert len(painted.balls_mm) == count and kept == before.regions[0]
    saved = draft.written
    draft.path = tmp_path
    assert draft.save(tuple(orders)).startswith("not saved: ")
    assert draft.written is saved


ELBOW = """<robot name="elbow">
<link name="upper"><collision><origin xyz="0 0 0.1"/><geometry>
  <box size="0.05 0.05 0.2"/></geometry></collision></link>
<link name="lower"><collision><origin xyz="0 0 0.1"/><geometry>
  <box size="0.05 0.05 0.2"/></geometry></collision></link>
<joint name="bend" type="revolute"><parent link="upper"/><child link="lower"/>
  <origin xyz="0 0 0.23"/><axis xyz="0 1 0"/>
  <limit lower="0" upper="2.6" effort="1" velocity="1"/></joint></robot>"""


def test_skin_stays_clear_of_a_link_that_moves(tmp_path):
    path = tmp_path / "elbow.urdf"
    path.write_text(ELBOW)
    robot = load_urdf(path)
    clearance = 5 * MM
    regions = tuple(RegionSpec(LinkZone(name), 2e4) for name in ("upper", "lower"))
    limits = DesignLimits(clearance=clearance)
    design = design_skin(robot, DesignSpec("elbow", regions, (), limits))
    mounted = MountedSkin(design.skin, robot)
    names = np.array(design.skin.link_names)[design.skin.patch_index]
    for angle in np.linspace(0.0, 2.6, 40):
        q = np.array([angle])
        positions, _ = mounted.place_taxels(q)
        poses = mounted.kinematics.poses(q)
        for link, T in zip(robot.links, poses, strict=True):
            others = positions[names != link.name]
            local = (others - T[:3, 3]) @ T[:3, :3]
            distance, _ = compute_surface_distance(link, local)
            # Between two positions of a sweep a link comes a little nearer.
            assert distance.min() > 0.8 * clearance
    free = design_skin(robot, DesignSpec("elbow", regions[:1]))
    assert design.skin.count > 100
    assert free.regions[0].allowed_area > design.regions[0].allowed_area


SLIDES = """<robot name="press">
<link name="table"><collision><origin xyz="-0.1 0 -0.02"/><geometry>
  <box size="0.2 0.08 0.04"/></geometry></collision></link>
<link name="carriage"/>
<link name="ram"><collision><origin xyz="0.12 0 0.03"/><geometry>
  <box size="0.2 0.06 0.06"/></geometry></collision></link>
<joint name="slide" type="prismatic"><parent link="table"/><child link="carriage"/>
  <origin xyz="0 0 0.051"/><axis xyz="-1 0 0"/><limit lower="0" upper="0.1"
  effort="1" velocity="1"/></joint>
<joint name="lower" type="prismatic"><parent link="carriage"/><child link="ram"/>
  <axis xyz="0 0 -1"/><limit lower="0" upper="0.05" effort="1" velocity="1"/></joint>
</robot>"""
"""A ram touches the table, to 1 mm, only where it is slid over it and lowered: then it
covers x from -0.08 m on, and y within 0.03 m."""
CLEARANCE = 3 * MM


def design_press(folder, poses, clears=False):
    path = folder / "press.urdf"
    path.write_text(SLIDES)
    regions = tuple(RegionSpec(LinkZone(name), DENSITY) for name in ("table", "ram"))
    limits = DesignLimits(clearance=CLEARANCE, poses=poses, clears_poses=clears)
    return design_skin(load_urdf(path), DesignSpec("press", regions, (), limits))


def measure_from_box(points, low, high):
    return np.linalg.norm(
        np.maximum(np.maximum(low - points, points - high), 0), axis=1
    )


def find_touching(skin):
    """Find the taxels that are near the other body in the one pose in which it is."""
    links = np.array(skin.link_names)[skin.patch_index]
    # Of the ram's box, 1 mm above the table; of the table's box, 1 mm below the ram.
    ram = measure_from_box(skin.positions, [-0.08, -0.03, 1e-3], [0.12, 0.03, 0.061])
    table = measure_from_box(skin.positions, [-0.1, -0.04, -0.041], [0.1, 0.04, -1e-3])
    return np.where(links == "table", ram, table) < CLEARANCE


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The design that looks at one joint at a time."""
    return design_press(tmp_path_factory.mktemp("press"), 0)


def test_taxels_that_touch_in_a_combined_pose_alone_are_told(alone, tmp_path):
    told = design_press(tmp_path, 128)
    assert np.array_equal(alone.skin.positions, told.skin.positions)
    assert not alone.close.any()
    touching = find_touching(told.skin)
    assert 50 < touching.sum() < 0.5 * len(touching)
    assert np.array_equal(told.close, touching)


def test_taxels_that_touch_in_a_combined_pose_can_be_left_out(alone, tmp_path):
    cleared = design_press(tmp_path, 128, True)
    assert not cleared.close.any() and not find_touching(cleared.skin).any()
    # On the table 8 x 6 cm are lost, and a rim as wide as a triangle.
    before, after = (each.regions[0].allowed_area for each in (alone, cleared))
    assert 0.08 * 0.06 < before - after < 0.09 * 0.08


def test_cells_are_cut_into_parts_that_boards_can_read():
    rng = np.random.default_rng(0)
    block = rng.random((16, 16)) < 0.9
    parts = list(iterate_routable(block, 8))
    assert sum(part.sum() for part in parts) > 0.7 * block.sum()
    assert (np.sum(parts, axis=0) <= block).all()
    for part in parts:
        used = part[np.ix_(part.any(axis=1), part.any(axis=0))]
        assert used.all(axis=1).any() and used.all(axis=0).any()
        for lines in (used, used.T):
            for line in lines:
                run_of_cells = np.flatnonzero(line)
                assert len(run_of_cells) == np.ptp(run_of_cells) + 1 > 1
    assert divide(0, 33, 16) == [(0, 11), (11, 22), (22, 33)]


# Drawings


@pytest.fixture(scope="module")
def written(designs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    return save_design(designs["ball"], folder), folder


def test_dxf_read_by_another_reader_agrees_with_the_skin(designs, written):
    """The reader of trimesh shares no code with the writer."""
    _, folder = written
    skin = load_skin(folder)
    for number, patch in enumerate(skin.patches):
        drawing = trimesh.load(folder / "patches" / f"{patch.id}.dxf")
        layers = np.array(drawing.layers)
        pads = [
            drawing.vertices[entity.points[:4]].mean(axis=0)
            for entity in drawing.entities[layers == "PADS"]
        ]
        flat = 1e3 * designs["ball"].layouts[number].grid.unrolled()
        np.testing.assert_allclose(pads, flat, atol=1e-6)
        assert np.count_nonzero(layers == "OUTLINE") == 1
        assert np.count_nonzero(layers == "ROWS") == patch.rows
        assert np.count_nonzero(layers == "COLUMNS") == patch.columns
        for layer in ("RETURNS", "CONNECTOR"):
            assert np.count_nonzero(layers == layer) == patch.rows + patch.columns
        assert np.count_nonzero(layers == "FIDUCIALS") == 3


def test_table_agrees_with_the_skin(written):
    _, folder = written
    skin = load_skin(folder)
    for patch in skin.patches:
        with (folder / "patches" / f"{patch.id}.csv").open() as file:
            rows = list(csv.DictReader(file))
        taxels = skin.find_taxels(patch.id)
        assert [int(row["taxel"]) for row in rows] == taxels.tolist()
        assert [int(row["row"]) for row in rows] == skin.rows[taxels].tolist()
        places = [[float(row[f"{axis}_mm"]) for axis in "xyz"] for row in rows]
        np.testing.assert_allclose(places, 1e3 * skin.positions[taxels], atol=1e-5)


@pytest.fixture(scope="module")
def saved_tube(designs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("tube")
    save_design(designs["tube"], folder)
    return folder


@pytest.mark.parametrize("name", ["tube", "ball"])
def test_saved_map_is_that_of_the_design_both_ways(designs, saved_tube, written, name):
    """A cylinder and planes, and unrolled triangles."""
    design = designs[name]
    folder = saved_tube if name == "tube" else written[1]
    kinds = set()
    for patch, layout in zip(design.skin.patches, design.layouts, strict=True):
        path = folder / "patches" / f"{patch.id}.map.json"
        kinds.add(json.loads(path.read_text())["surface"])
        link, surface = load_map(path)
        assert link == patch.link
        flat = layout.grid.unrolled()
        points = layout.surface.wrap(flat)
        same = surface.wrap(flat)
        for part in ("positions", "normals", "tangents", "area_scale"):
            np.testing.assert_allclose(
                getattr(same, part), getattr(points, part), atol=1e-12
            )
        np.testing.assert_allclose(surface.unroll(points.positions), flat, atol=1e-9)
    assert kinds == ({"tube", "plane"} if name == "tube" else {"mesh"})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"surface": "cone"}, "surface"),
        ({"radius": None}, "radius"),
        ({"T_link_surface": [[1.0]]}, "T_link_surface"),
        ({"surface": "mesh"}, "0 vertices"),
        ({"extra": 1}, "extra"),
    ],
)
def test_damaged_map_is_refused_in_one_line(saved_tube, tmp_path, change, said):
    maps = sorted((saved_tube / "patches").glob("*.map.json"))
    around = next(text for text in map(Path.read_text, maps) if '"tube"' in text)
    path = tmp_path / "damaged.map.json"
    path.write_text(json.dumps(json.loads(around) | change))
    with pytest.raises(SkinError) as caught:
        load_map(path)
    assert said in str(caught.value) and "\n" not in str(caught.value)


def test_lines_of_a_layer_never_meet_and_stay_inside(designs):
    for name in SHAPES:
        for drawing in draw_design(designs[name]):
            outline = Polygon(drawing.select("OUTLINE")[0].points)
            assert outline.is_valid
            for layer in ("ROWS", "COLUMNS", "RETURNS"):
                lines = [LineString(line.points) for line in drawing.select(layer)]
                assert all(outline.covers(line) for line in lines), drawing.name
                assert not any(a.intersects(b) for a, b in combinations(lines, 2))
            pads = [Polygon(line.points) for line in drawing.select("PADS")]
            marks = [
                LineString([mark, mark]).buffer(drawing.fiducial_radius)
                for mark in drawing.fiducials
            ]
            assert not any(p.intersects(m) for p in pads for m in marks)


def test_same_design_gives_the_same_files(robots, written, tmp_path):
    _, folder = written
    save_design(design_skin(robots["ball"], make_spec()), tmp_path)
    names = sorted(p.relative_to(folder) for p in folder.rglob("*") if p.is_file())
    assert len(names) > 10
    for name in names:
        assert (tmp_path / name).read_bytes() == (folder / name).read_bytes(), name


def test_report_has_the_figures_of_the_skin(designs, written):
    report, folder = written
    assert json.loads((folder / "report.json").read_text()) == report
    skin = designs["ball"].skin
    assert report["taxels"] == skin.count
    assert report["boards"] == len(skin.patches)
    assert 0.5 < report["coverage"] <= report["coverage_of_allowed"] < 1.0
    counts = np.bincount(skin.patch_index)
    bits = sum(8 * (2 * count + 18) for count in counts)
    assert report["bandwidth_mbit_s"] == pytest.approx(1e-6 * 100 * bits, abs=1e-3)


# Surfaces and distances


def make_surface(folder, mesh):
    return build_link_surface(load_urdf(write_mesh(folder, mesh)).links[0])


def test_overlapping_bodies_become_one_closed_surface(tmp_path):
    """What the first box hides of the second is not there any more."""
    first = trimesh.creation.box((0.1, 0.1, 0.1))
    second = first.copy()
    second.apply_translation((0.05, 0.0, 0.0))
    surface = make_surface(tmp_path, trimesh.util.concatenate([first, second]))
    mesh = trimesh.Trimesh(surface.vertices, surface.faces)
    assert mesh.is_watertight and mesh.body_count == 1
    assert mesh.volume == pytest.approx(0.1 * 0.1 * 0.15, rel=1e-6)
    assert surface.warnings == ()


@pytest.mark.parametrize(("kind", "warned"), [("hole", True), ("inverted", False)])
def test_broken_mesh_is_repaired_with_a_warning(tmp_path, kind, warned):
    broken = trimesh.creation.icosphere(3, 0.05)
    if kind == "hole":
        broken.update_faces(np.arange(len(broken.faces)) >= 40)
    else:
        broken.unmerge_vertices()
        broken.invert()
    surface = make_surface(tmp_path, broken)
    assert bool(surface.warnings) == warned
    mesh = trimesh.Trimesh(surface.vertices, surface.faces)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(4 / 3 * np.pi * 0.05**3, rel=0.08)


def test_mesh_without_a_volume_is_refused(tmp_path):
    flat = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    with pytest.raises(RobotError, match="no body of 1 mm3 .* choose another link"):
        make_surface(tmp_path, flat)


def test_mesh_of_separate_triangles_is_wrapped(tmp_path, monkeypatch):
    """Without a body for each of them."""
    monkeypatch.setattr("eskin.design.surface.MAX_BODIES", 100)
    ball = trimesh.creation.icosphere(2, 0.05)
    soup = ball.triangles + np.random.default_rng(0).normal(0.0, 1e-5, (320, 3, 3))
    loose = trimesh.Trimesh(
        soup.reshape(-1, 3), np.arange(soup.size // 3).reshape(-1, 3)
    )
    surface = make_surface(tmp_path, loose)
    (warning,) = surface.warnings
    assert "1 of 1 bodies are broken; wrapped" in warning
    mesh = trimesh.Trimesh(surface.vertices, surface.faces)
    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(ball.volume, rel=0.03)


def test_surface_of_many_triangles_is_simplified_and_stays_where_it_is(
    robots, monkeypatch
):
    link = robots["torus"].links[0]
    every = build_link_surface(link)
    monkeypatch.setattr("eskin.design.surface.MANY_TRIANGLES", 100)
    monkeypatch.setattr("eskin.design.surface.SIMPLIFIED", 8e-4)
    fewer = build_link_surface(link)
    assert len(fewer.faces) < 0.9 * len(every.faces)
    points = np.concatenate([fewer.vertices, fewer.corners.mean(axis=1)])
    away, _ = compute_surface_distance(link, points)
    assert np.abs(away).max() < 1e-3


def test_design_does_not_depend_on_how_much_is_computed_at_once(
    robots, designs, monkeypatch
):
    """Such parts bound the memory."""
    monkeypatch.setattr("eskin.design.zones.FACES_AT_ONCE", 100)
    monkeypatch.setattr("eskin.design.patches.CELLS_AT_ONCE", 7)
    found = design_skin(robots["box"], make_spec()).skin
    np.testing.assert_array_equal(found.positions, designs["box"].skin.positions)


@pytest.mark.parametrize(
    ("shape", "density", "part"),
    [
        ('<box size="200 100 300"/>', 1e4, "200 x 100 x 300 m large: its surface"),
        ('<box size="200 100 300"/>', 1e-3, "triangles of 10 mm"),
        ('<box size="1000 0.002 0.002"/>', 1e4, "1e+03 x 0.002 x 0.002 m large"),
        ('<sphere radius="1000"/>', 1e4, "2e+03 x 2e+03 x 2e+03 m large"),
        ('<sphere radius="0.1"/>', 1e8, "room for 1.26e+07 taxels; allowed: 200,000"),
    ],
)
def test_more_than_a_skin_can_hold_is_refused_before_it_is_laid(
    tmp_path, monkeypatch, shape, density, part
):
    monkeypatch.setattr("eskin.design.design.lay_patches", None)
    robot = load_urdf(write_urdf(tmp_path, shape))
    with pytest.raises((RobotError, SkinError), match=re.escape(part)):
        design_skin(robot, make_spec(density, min_spacing=1e-6))


def test_region_of_too_many_triangles_is_cut_before_it_is_unrolled(robots, monkeypatch):
    monkeypatch.setattr("eskin.design.unroll.MAX_FLATTENED", 500)
    design = design_skin(robots["ball"], make_spec())
    sizes = [len(layout.surface.faces) for layout in design.layouts]
    assert max(sizes) <= 500 and sum(sizes) > 1000


def test_links_share_the_triangles_that_are_allowed(tmp_path, monkeypatch):
    monkeypatch.setattr("eskin.design.design.MAX_TRIANGLES", 40_000)
    link = write_urdf(tmp_path, SHAPES["ball"]).read_text()
    link = link[link.index("<link") : link.index("</robot>")]
    others = "".join(
        f'{link.replace("body", name)}<joint name="{name}" type="fixed">'
        f'<parent link="body"/><child link="{name}"/></joint>'
        for name in ("second", "third")
    )
    path = tmp_path / "three.urdf"
    path.write_text(f'<robot name="three">{link}{others}</robot>')
    names = ("body", "second", "third")
    regions = tuple(RegionSpec(LinkZone(name), DENSITY) for name in names)
    with pytest.raises(RobotError, match="link .(second|third). is 0.0999 x"):
        design_skin(load_urdf(path), DesignSpec("three", regions))


def test_patches_that_no_skin_may_have_are_refused(robots, monkeypatch):
    monkeypatch.setattr("eskin.design.design.MAX_PATCHES", 3)
    with pytest.raises(SkinError, match="more than 3 patches.* lower the density"):
        design_skin(robots["box"], make_spec())


@pytest.mark.parametrize("name", ["ball", "tube"])
def test_distance_on_a_surface_is_its_geodesic(robots, name):
    """It is the arc on a sphere, and the helix on a cylinder."""
    rng = np.random.default_rng(3)
    angle = rng.uniform(-1.5, 1.5, 12)
    z = rng.uniform(-0.05, 0.05, 12)
    points = np.column_stack([0.04 * np.cos(angle), 0.04 * np.sin(angle), z])
    arcs = 0.04 * (angle[:3, None] - angle)
    expected = np.hypot(arcs, z[:3, None] - z)
    if name == "ball":
        points = 0.05 * points / np.linalg.norm(points, axis=1, keepdims=True)
        cosine = points[:3] @ points.T / 0.05**2
        expected = 0.05 * np.arccos(np.clip(cosine, -1.0, 1.0))
    surface = build_link_surface(robots[name].links[0])
    found = SurfaceDistance(surface, points).between(np.arange(3), np.arange(12))
    np.testing.assert_allclose(found, expected, rtol=0.03, atol=1e-9)


def test_distance_between_separate_bodies_is_infinite(tmp_path):
    first = trimesh.creation.box((0.02, 0.02, 0.02))
    second = first.copy()
    second.apply_translation((0.1, 0.0, 0.0))
    surface = make_surface(tmp_path, trimesh.util.concatenate([first, second]))
    points = np.array([[0.0, 0.0, 0.01], [0.1, 0.0, 0.01], [0.005, 0.0, 0.01]])
    found = SurfaceDistance(surface, points).between(np.array([0]), np.arange(3))
    np.testing.assert_allclose(found, [[0.0, np.inf, 0.005]], atol=1e-4)


# The command


def test_command_writes_a_skin_that_the_check_accepts(tmp_path, capsys):
    out = tmp_path / "skin"
    words = "skin", "design", "tube", "--out", out, "--density", 1
    report, _ = call_json(capsys, *words)
    assert report["taxels"] == load_skin(out).count > 200
    check = f"skin check {out} --robot tube --tolerance 0.2"
    assert run(check.split()) == run(["skin", "show", str(out)]) == 0


@pytest.mark.parametrize(
    ("shape", "turn"), [*((name, ()) for name in SHAPES), ("tube", ("--turn", 30))]
)
def test_matrix_is_laid_on_the_surface_with_its_own_distances(
    shape, turn, tmp_path, capsys
):
    trimesh.creation.torus(0.06, 0.03, 48, 20).export(tmp_path / "torus.stl")
    urdf = write_urdf(tmp_path, SHAPES[shape])
    out = tmp_path / "skin"
    words = ("skin", "place", urdf, "--link", "body", "--rows", 6, "--columns", 4)
    # A slow computer is told of the progress on stderr.
    code, text, _ = call(capsys, *words, "--pitch-mm", 5, "-o", out, *turn, "--json")
    found = json.loads(text.splitlines()[-1])
    skin = load_skin(out)
    assert code == 0
    grid = skin.positions.reshape(6, 4, 3)
    for axis in (0, 1):
        steps = np.linalg.norm(np.diff(grid, axis=axis), axis=2)
        error = 0.015 + found["distortion"]
        np.testing.assert_allclose(steps, 5 * MM, rtol=error)
    assert check_skin(skin, load_urdf(urdf)) == []
    across = np.cross(grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0])
    assert (skin.normals @ across > 0).all()


def test_click_places_the_matrix_that_the_command_places(tmp_path, capsys):
    urdf = write_urdf(tmp_path, SHAPES["box"])
    spec = tmp_path / "spec.yaml"
    folder = tmp_path / "skin"
    out = tmp_path / "same"
    draft = SpecDraft(spec, SpecFile(), None, load_urdf(urdf), folder)
    orders = tuple(
        PaintOrder(n, "body", (0.04, 0.0, z), 0.04, False, (4, 5, 0.006))
        for n, z in enumerate((0.01, 0.0))
    )
    with pytest.raises(SkinError, match="does not lie on link 'body'"):
        draft.place(replace(orders[0], matrix=(90, 90, 0.006)))
    assert draft.save(orders) == f"saved: {folder}" and not spec.exists()
    words = ("--link", "body", "--rows", 4, "--columns", 5, "--pitch-mm", 6)
    call(capsys, "skin", "place", urdf, *words, "--at", 40, 0, 0, "--out", out)
    # The later click on a link moves its matrix.
    found = load_skin(str(folder))
    same = load_skin(str(out))
    assert np.array_equal(found.positions, same.positions)


def test_matrices_of_other_patches_are_added_and_one_is_replaced(tmp_path, capsys):
    urdf = write_urdf(tmp_path, SHAPES["tube"])
    out = tmp_path / "skin"

    def place(patch, *more):
        words = ("skin", "place", urdf, "--link", "body", "--patch", patch)
        size = ("--rows", 3, "--columns", 4, "--pitch-mm", 5, "--out", out)
        call_json(capsys, *words, *size, *more)
        skin = load_skin(out)
        return skin, skin.positions[skin.find_taxels(patch)].reshape(3, 4, 3)

    _, first = place("a", "--at", 40, 0, 0)
    _, second = place("b", "--at", -40, 0, 0)
    skin, flipped = place("a", "--at", 40, 0, 0, "--flip")
    assert {(patch.id, patch.address) for patch in skin.patches} == {("a", 1), ("b", 2)}
    np.testing.assert_allclose(flipped, first[:, ::-1], atol=1e-6)
    assert first[..., 0].min() > 0 > second[..., 0].max()


def test_matrix_without_room_is_refused_and_nothing_is_written(tmp_path, capsys):
    urdf = write_urdf(tmp_path, SHAPES["box"])
    words = ("skin", "place", urdf, "--link", "body", "--rows", 30)
    size = (
        "--columns",
        30,
        "--pitch-mm",
        6,
        "--out",
        tmp_path / "skin",
        "--at",
        0,
        0,
        60,
    )
    assert_refused(capsys, *words, *size, part="taxels hang over")
    assert not (tmp_path / "skin").exists()


@pytest.mark.parametrize(
    ("shape", "at"), [("tube", ()), *((name, ("--at", 60, 0, 40)) for name in SHAPES)]
)
def test_pitch_that_is_advised_is_accepted_and_the_next_is_not(
    shape, at, tmp_path, capsys
):
    trimesh.creation.torus(0.06, 0.03, 48, 20).export(tmp_path / "torus.stl")
    urdf = write_urdf(tmp_path, SHAPES[shape])
    out = tmp_path / "skin"
    words = ("skin", "place", urdf, "--link", "body", "--rows", 9, "--columns", 7)
    words = (*words, *at, "--out", out, "--pitch-mm")
    code, _, err = call(capsys, *words, 40)
    assert code == 2 and not out.exists()
    pitch = float(re.search(r"--pitch-mm ([\d.]+) fits", err)[1])
    assert call(capsys, *words, pitch)[0] == 0
    assert len(load_skin(out).positions) == 63
    assert call(capsys, *words, 1.1 * pitch)[0] == 2


def test_link_that_is_no_obstacle_for_a_matrix_is_told(tmp_path, capsys, caplog):
    urdf = write_urdf(tmp_path, SHAPES["box"])
    out = tmp_path / "skin"
    more = (
        '<link name="lid"><collision><geometry><mesh filename="gone.stl"/></geometry>'
    )
    joint = '<joint name="j" type="fixed"><parent link="body"/><child link="lid"/>'
    text = urdf.read_text().replace("</robot>", f"{more}</collision></link>{joint}")
    urdf.write_text(f"{text}</joint></robot>")
    words = ("skin", "place", urdf, "--link", "body", "--rows", 3, "--columns", 4)
    assert call(capsys, *words, "--pitch-mm", 5, "--out", out)[0] == 0
    [line] = caplog.messages
    assert "gone.stl" in line and "'lid'" in line and "no obstacle" in line


def test_place_without_room_for_any_pitch_is_told(tmp_path, capsys):
    urdf = write_urdf(tmp_path, SHAPES["box"])
    out = tmp_path / "skin"
    words = ("skin", "place", urdf, "--link", "body", "--rows", 9, "--columns", 7)
    on_edge = ("--pitch-mm", 6, "--at", 40, 50, 0, "--out", out)
    assert_refused(capsys, *words, *on_edge, part="no pitch fits")


SPEC = """
regions:
- {link: tube, density_per_cm2: 2.0, box_mm: [[-100, -100, 0], [100, 100, 150]]}
keep_out:
- {link: tube, point_mm: [37.5, 0, 75], radius_mm: 20}
"""


def test_command_reads_regions_and_keep_outs(tmp_path):
    spec = tmp_path / "spec.yaml"
    out = tmp_path / "skin"
    spec.write_text(SPEC.replace("tube,", f"{load_robot('tube').links[-1].name},"))
    command = ["skin", "design", "tube", "--out", str(out), "--spec", str(spec)]
    assert run(command) == 0
    skin = load_skin(out)
    assert skin.positions[:, 2].min() > 0.0
    away = np.linalg.norm(skin.positions - [0.0375, 0.0, 0.075], axis=1)
    assert away.min() > 0.02
    assert skin.count / (1e4 * skin.areas.sum()) == pytest.approx(2.0, rel=0.02)


@pytest.mark.parametrize(
    ("action", "options", "part"),
    [
        ("design", "--density 100", "100 taxels/cm2"),
        ("design", "--density -1", "--density is -1"),
        ("design", "--links nose", "no link 'nose'"),
        ("design", "--rows 1", "--rows is 1"),
        ("design", "--distortion 0", "--distortion is 0"),
        ("design", "--density 0.001", "no patch of 8 taxels"),
        ("design", "--spec missing.yaml", "missing.yaml"),
        ("paint", "--links nose", "no link 'nose'"),
        ("paint", "--density 0", "--density is 0"),
        ("paint", "--port 70000", "port is 70000"),
    ],
)
def test_command_refuses_what_cannot_be_made_in_one_line(
    tmp_path, capsys, action, options, part
):
    out = ["--out" if action == "design" else "--spec", tmp_path / "x"]
    assert_refused(capsys, "skin", action, "tube", *out, *options.split(), part=part)
    assert not (tmp_path / "x").exists()


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("regions: [{link: a, box_mm: [[0,0,0],[1,1,0]]}]", "regions[0]"),
        ("regions: [{link: a, point_mm: [0,0,0]}]", "radius_mm"),
        ("regions: [{links: a}]", "regions[0]"),
        ("regions: [{link: a, balls_mm: []}]", "regions[0].balls_mm"),
        ("regions: [{link: a, balls_mm: [[0,0,0,0]]}]", "radius above 0"),
        ("keep_out: 3", "keep_out"),
    ],
)
def test_specification_with_an_error_is_refused_in_one_line(
    tmp_path, capsys, text, part
):
    spec = tmp_path / "spec.yaml"
    spec.write_text(text)
    words = "skin", "design", "tube", "--out", tmp_path / "x", "--spec", spec
    assert_refused(capsys, *words, part=part)


def test_region_of_a_link_without_a_shape_is_refused(tmp_path):
    path = tmp_path / "bare.urdf"
    path.write_text('<robot name="bare"><link name="body"/></robot>')
    with pytest.raises(RobotError, match="has no surface"):
        design_skin(load_urdf(path), make_spec())
    with pytest.raises(SkinError, match="no link with a shape"):
        design_skin(load_urdf(path), DesignSpec("bare", ()))
