"""Design skins for robots of example-robot-data, and check what holds of them.

    python -m lab.skin_design robots --pictures docs/pictures
    python -m lab.skin_design seeds --seeds 20
    python -m lab.skin_design distances

`robots` covers six robots by one command each and prints a table. `seeds` covers links
drawn at random, at densities and with keep-out zones drawn at random, and measures each
law of a design by other means than those that made it. `distances` measures paths along
meshes of shapes whose geodesics are known.
"""

import argparse
import json
import shutil
import sys
import tempfile
import time
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Any

import igl
import numpy as np
import trimesh

from eskin.cli.main import run
from eskin.design import (
    BallZone,
    DesignSpec,
    LinkZone,
    PatchLayout,
    RegionSpec,
    SkinDesign,
    SurfaceDistance,
    build_link_surface,
    design_skin,
    save_design,
)
from eskin.design.surface import LinkSurface
from eskin.design.zones import iterate_relative_poses
from eskin.robot import Geom, Link, Robot, compute_surface_distance, load_robot
from eskin.robot.shapes import TriangleMesh
from eskin.skin import load_skin
from eskin.skin.picture import draw_skin
from lab.tables import format_head, format_row

PAIRS = 30
"""Number of pairs of neighbours whose distance is measured for each seed."""


@dataclass(frozen=True)
class ExampleRobot:
    """An example names a URDF, a density, and a pose for its picture."""

    path: str
    density: float
    """Density of the taxels [1/cm2]."""
    pose: dict[str, float]
    """Values of joints [rad] by the ends of their names; others are at 0."""


ARM = {
    "lift_joint": -1.2,
    "elbow_joint": 1.4,
    "wrist_1_joint": -1.4,
    "wrist_2_joint": -1.4,
}
ROBOTS = {
    "ur5": ExampleRobot("ur_description/urdf/ur5_robot.urdf", 1.5, ARM),
    "ur10": ExampleRobot("ur_description/urdf/ur10_robot.urdf", 1.0, ARM),
    "panda": ExampleRobot(
        "panda_description/urdf/panda.urdf",
        1.5,
        {"joint1": 0.3, "joint2": 0.2, "joint4": -2.0, "joint6": 2.2, "joint7": 0.8},
    ),
    "go2": ExampleRobot(
        "go2_description/urdf/go2.urdf",
        1.5,
        {"thigh_joint": 0.8, "calf_joint": -1.5},
    ),
    "talos": ExampleRobot(
        "talos_data/robots/talos_full_v2.urdf",
        0.4,
        {
            "arm_left_2_joint": 0.4,
            "arm_right_2_joint": -0.4,
            "arm_left_4_joint": -0.9,
            "arm_right_4_joint": -0.9,
        },
    ),
    "allegro": ExampleRobot(
        "allegro_hand_description/urdf/allegro_right_hand.urdf",
        9.0,
        {"joint_12.0": 1.0, "joint_13.0": 0.5},
    ),
}
HEAD = (
    *("robot", "asked [1/cm2]", "time", "links", "patches", "taxels"),
    *("taxels per cm2", "distortion", "of allowed", "traces", "at 100 Hz", "close"),
)
MEANT = {"ur5": 2000, "ur10": 2000, "panda": 2000, "go2": 5000, "talos": 5000}
"""Number of taxels that each skin is to have at least."""


def find_robot(name: str) -> Path:
    """Return the URDF of an example robot."""
    parts = ("cmeel.prefix", "share", "example-robot-data", "robots")
    for place in filter(None, sys.path):
        path = Path(place).joinpath(*parts, ROBOTS[name].path)
        if path.is_file():
            return path
    raise SystemExit("example-robot-data is not installed: pip install '.[models]'")


def design_robots(names: list[str], pictures: Path | None) -> None:
    """Design the skin of each robot by the command, and print a row for each."""
    rows = []
    for name in names:
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / name
            urdf = str(find_robot(name))
            density = str(ROBOTS[name].density)
            command = ["skin", "design", urdf, "--out", str(out), "--density", density]
            start = time.perf_counter()
            code = run(command)
            seconds = time.perf_counter() - start
            check = ["skin", "check", str(out), "--robot", urdf, "--tolerance", "0.2"]
            if code or run(check):
                raise SystemExit(f"{name}: the design or its check failed")
            report = json.loads((out / "report.json").read_text())
            if report["taxels"] < MEANT.get(name, 0):
                raise SystemExit(f"{name}: {report['taxels']} taxels are too few")
            rows.append(build_row(name, seconds, report))
            if pictures is not None:
                draw_robot(name, out, pictures)
    print(format_head(HEAD))
    for row in rows:
        print(format_row(row))


def build_row(name: str, seconds: float, report: dict[str, Any]) -> list[str]:
    """Build the cells of one robot's row."""
    covered = [row for row in report["regions"] if row["patches"]]
    return [
        name,
        f"{ROBOTS[name].density:g}",
        f"{seconds:.0f} s",
        str(len(covered)),
        str(report["boards"]),
        f"{report['taxels']:,}",
        f"{report['density_per_cm2']:.3f}",
        f"{100 * report['distortion_max']:.1f} %",
        f"{100 * report['coverage_of_allowed']:.0f} %",
        f"{report['wiring_m']:.0f} m",
        f"{report['bandwidth_mbit_s']:.1f} Mbit/s",
        f"{100 * report['taxels_close'] / report['taxels']:.0f} %",
    ]


def draw_robot(name: str, skin: Path, pictures: Path) -> None:
    """Draw a robot with its skin; of the first one also the drawings of its patches."""
    robot = load_robot(find_robot(name))
    q = np.zeros(len(robot.joint_names))
    for end, value in ROBOTS[name].pose.items():
        q[[joint.endswith(end) for joint in robot.joint_names]] = value
    q = np.clip(q, robot.lower, robot.upper)
    draw_skin(load_skin(skin), pictures / f"design_{name}.webp", robot, q)
    if name == next(iter(ROBOTS)):
        shutil.copy(skin / "sheet.svg", pictures / "design_sheet.svg")
        patch = skin / "patches" / "forearm_link_1.svg"
        shutil.copy(patch, pictures / "design_patch.svg")


def check_seeds(seeds: int) -> None:
    """Design skins at random and print the worst of each law."""
    worst: dict[str, float] = {}
    for seed in range(seeds):
        name = list(ROBOTS)[seed % len(ROBOTS)]
        robot = load_robot(find_robot(name))
        rng = np.random.default_rng(seed)
        spec = draw_spec(robot, ROBOTS[name].density, rng)
        start = time.perf_counter()
        design = design_skin(robot, spec, seed)
        seconds = time.perf_counter() - start
        laws = measure_laws(robot, design, rng)
        links = ", ".join(region.zone.link for region in spec.regions)
        figures = ", ".join(f"{law} {value:.4g}" for law, value in laws.items())
        print(f"seed {seed}, {name} ({links}): {seconds:.1f} s, {figures}", flush=True)
        for law, value in laws.items():
            least = law.endswith(("clearance", "taxels"))
            pick = min if least else max
            worst[law] = pick(worst.get(law, value), value)
    print("worst: " + ", ".join(f"{law} {value:.4g}" for law, value in worst.items()))


def draw_spec(robot: Robot, density: float, rng: np.random.Generator) -> DesignSpec:
    """Draw three large links, a density for each, and three keep-out zones."""
    surfaces = {
        link.name: build_link_surface(link) for link in robot.links if link.geoms
    }
    whole = [
        name
        for name, own in surfaces.items()
        if not own.warnings and compute_area(own) > 40 / (1e4 * density)
    ]
    names = rng.choice(whole, size=min(3, len(whole)), replace=False).tolist()
    regions = tuple(
        RegionSpec(LinkZone(name), 1e4 * density * rng.uniform(0.7, 1.3))
        for name in names
    )
    zones = []
    for name in names:
        vertices = surfaces[name].vertices
        x, y, z = vertices[rng.integers(len(vertices))].tolist()
        zones.append(BallZone(name, (x, y, z), float(rng.uniform(0.01, 0.03))))
    return DesignSpec("random", regions, tuple(zones))


def compute_area(surface: LinkSurface) -> float:
    """Return the area of a surface [m2]."""
    return float(igl.doublearea(surface.vertices, surface.faces).sum() / 2)


def measure_laws(
    robot: Robot, design: SkinDesign, rng: np.random.Generator
) -> dict[str, float]:
    """Measure each law of a design; distances are in millimetres."""
    skin = design.skin
    density = []
    for result in design.regions:
        for number in result.patches:
            areas = skin.areas[skin.patch_index == number]
            density.append(len(areas) / areas.sum() / result.region.density - 1)
    spacing, stated = measure_spacing(robot, design, rng)
    return {
        "taxels": skin.count,
        "off surface": 1e3 * measure_surface_distance(robot, design),
        "density error": float(np.abs(density).max()),
        "distortion": max(layout.distortion for layout in design.layouts),
        "spacing error": spacing,
        "spacing beyond stated": stated,
        "overlapping points": count_overlaps(design),
        "points in keep-outs": count_kept_out(design),
        "clearance": 1e3 * measure_clearance(robot, design, rng),
    }


def measure_surface_distance(robot: Robot, design: SkinDesign) -> float:
    """Return the largest distance of a taxel from the shapes of its link [m]."""
    names = np.array(design.skin.link_names)[design.skin.patch_index]
    worst = 0.0
    for name in set(names.tolist()):
        link = robot.links[robot.link_index(name)]
        points = design.skin.positions[names == name]
        worst = max(
            worst, float(np.abs(compute_surface_distance(link, points)[0]).max())
        )
    return worst


def measure_spacing(
    robot: Robot, design: SkinDesign, rng: np.random.Generator
) -> tuple[float, float]:
    """Compare distances in the drawings with paths along the surfaces.

    Returns:
        The largest relative error, and the largest excess over the stated distortion.
    """
    errors, excess = [0.0], [0.0]
    surfaces = {}
    with tempfile.TemporaryDirectory() as folder:
        save_design(design, Path(folder))
        numbers = rng.choice(len(design.layouts), size=min(6, len(design.layouts)))
        for number in numbers.tolist():
            patch, layout = design.skin.patches[number], design.layouts[number]
            pads = read_pads(Path(folder) / "patches" / f"{patch.id}.dxf")
            taxels = design.skin.find_taxels(patch.id)
            gaps = np.linalg.norm(pads[:, None] - pads[None], axis=2)
            near = np.argwhere(np.triu(gaps < 1.01 * 1e3 * layout.grid.column_pitch, 1))
            near = near[rng.permutation(len(near))[: PAIRS // len(numbers)]]
            if patch.link not in surfaces:
                link = robot.links[robot.link_index(patch.link)]
                surfaces[patch.link] = build_link_surface(link)
            used, index = np.unique(near, return_inverse=True)
            along = SurfaceDistance(
                surfaces[patch.link], design.skin.positions[taxels[used]]
            )
            for (i, j), (a, b) in zip(index.reshape(-1, 2), near, strict=True):
                length = along.between(np.array([i]), np.array([j]))[0, 0]
                error = abs(1e3 * length / gaps[a, b] - 1)
                errors.append(error)
                excess.append(error - layout.distortion)
    return max(errors), max(excess)


def read_pads(path: Path) -> np.ndarray:
    """Return the centres of the pads of a DXF [mm], by the reader of trimesh."""
    drawing = trimesh.load(path)
    return np.array(
        [
            drawing.vertices[entity.points[:4]].mean(axis=0)
            for entity, layer in zip(drawing.entities, drawing.layers, strict=True)
            if layer == "PADS"
        ]
    )


def sample_cells(layout: PatchLayout) -> np.ndarray:
    """Return 16 points of the link in each cell of a patch."""
    steps = 0.9 * layout.grid.column_pitch * np.linspace(-0.5, 0.5, 4)
    offsets = np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)
    flat = layout.grid.unrolled()[:, None] + offsets
    return layout.surface.wrap(flat.reshape(-1, 2)).positions


def count_overlaps(design: SkinDesign) -> int:
    """Count points of cells that lie in a cell of another patch of the link."""
    count = 0
    links = design.skin.link_names
    samples = [sample_cells(layout) for layout in design.layouts]
    for first, second in combinations(range(len(links)), 2):
        if links[first] != links[second]:
            continue
        layout, points = design.layouts[second], samples[first]
        flat = layout.surface.unroll(points)
        back = layout.surface.wrap(flat).positions
        here = flat[np.linalg.norm(back - points, axis=1) < 1e-7]
        away = np.abs(here[:, None] - layout.grid.unrolled()[None]).max(axis=2)
        count += int((away < 0.49 * layout.grid.column_pitch).any(axis=1).sum())
    return count


def count_kept_out(design: SkinDesign) -> int:
    """Count points of cells that lie in a keep-out zone."""
    return sum(
        int(zone.contains(sample_cells(layout)).sum())
        for layout, link in zip(design.layouts, design.skin.link_names, strict=True)
        for zone in design.spec.keep_outs
        if zone.link == link
    )


def measure_clearance(
    robot: Robot, design: SkinDesign, rng: np.random.Generator
) -> float:
    """Return the smallest distance of a taxel from another link [m]."""
    coarse = {link.name: build_link_surface(link) for link in robot.links if link.geoms}
    names = np.array(design.skin.link_names)[design.skin.patch_index]
    least = np.inf
    for first, second, T in iterate_relative_poses(robot, list(coarse)):
        if rng.random() > 0.3:
            continue
        for own, other, pose in ((first, second, T), (second, first, np.linalg.inv(T))):
            points = design.skin.positions[names == own]
            if len(points) == 0:
                continue
            moved = points @ pose[:3, :3].T + pose[:3, 3]
            low, high = coarse[other].vertices.min(0), coarse[other].vertices.max(0)
            near = np.all((moved > low - 0.01) & (moved < high + 0.01), axis=1)
            if near.any():
                distance = igl.signed_distance(
                    np.ascontiguousarray(moved[near]),
                    coarse[other].vertices,
                    coarse[other].faces,
                    igl.SIGNED_DISTANCE_TYPE_FAST_WINDING_NUMBER,
                )[0]
                least = min(least, float(distance.min()))
    return least if np.isfinite(least) else 0.01


def measure_distances() -> None:
    """Print the error of paths on meshes of a sphere, a cylinder and a torus."""
    rng = np.random.default_rng(0)
    for corners in (24, 48, 96):
        print(f"{corners} corners: {measure_shapes(corners, rng)}")


def measure_shapes(corners: int, rng: np.random.Generator) -> str:
    """Return the largest errors on meshes whose circles have a number of corners."""
    unit = rng.normal(size=(40, 3))
    unit /= np.linalg.norm(unit, axis=1, keepdims=True)
    ball = trimesh.creation.uv_sphere(0.06, (corners // 2, corners))
    arcs = 0.06 * np.arccos(np.clip(unit[:4] @ unit.T, -1, 1))
    angle, z = rng.uniform(-1.5, 1.5, 40), rng.uniform(-0.08, 0.08, 40)
    tube = trimesh.creation.cylinder(0.04, 0.2, sections=corners)
    on_tube = np.column_stack([0.04 * np.cos(angle), 0.04 * np.sin(angle), z])
    helix = np.hypot(0.04 * (angle[:4, None] - angle[None]), z[:4, None] - z[None])
    torus = trimesh.creation.torus(0.08, 0.03, corners, corners // 2)
    turn = np.linspace(0, np.pi, 20)
    around = np.column_stack(
        [0.08 + 0.03 * np.cos(turn), 0 * turn, 0.03 * np.sin(turn)]
    )
    texts = []
    for name, mesh, points, known in (
        ("sphere", ball, 0.06 * unit, arcs),
        ("cylinder", tube, on_tube, helix),
        ("torus", torus, around, 0.03 * np.abs(turn[:1, None] - turn[None])),
    ):
        shape = TriangleMesh(np.array(mesh.vertices), np.array(mesh.faces))
        surface = build_link_surface(Link(name, (Geom(shape, np.eye(4)),)))
        start = time.perf_counter()
        found = SurfaceDistance(surface, points).between(
            np.arange(len(known)), np.arange(known.shape[1])
        )
        each = (time.perf_counter() - start) / len(known)
        far = known > 1e-3
        error = np.abs(found[far] / known[far] - 1)
        texts.append(
            f"{name} {100 * error.max():.2f} %, median {100 * np.median(error):.2f} %, "
            f"{len(surface.faces)} triangles, {1e3 * each:.0f} ms a source"
        )
    return "; ".join(texts)


def main() -> None:
    """Run one of the measurements."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("what", choices=("robots", "seeds", "distances"))
    parser.add_argument(
        "--robots", nargs="+", choices=list(ROBOTS), default=list(ROBOTS)
    )
    parser.add_argument("--pictures", type=Path)
    parser.add_argument("--seeds", type=int, default=20)
    options = parser.parse_args()
    match options.what:
        case "robots":
            design_robots(options.robots, options.pictures)
        case "seeds":
            check_seeds(options.seeds)
        case _:
            measure_distances()


if __name__ == "__main__":
    main()
