"""Touches on small skins and on the ur5, and the same moved, mirrored or renumbered."""

from dataclasses import dataclass, fields, replace
from functools import cache

import numpy as np
import torch

from eskin.graph import (
    HISTORY,
    PRESSURE_SUMMARY,
    GraphBatch,
    GraphBuilder,
    GraphConfig,
    compute_summary,
    join_graphs,
)
from eskin.nn import NetworkInput, SlotIndex, build_graph_tensors
from eskin.robot import Joint, Link, Robot, load_robot
from eskin.skin import (
    MountedSkin,
    Patch,
    Plane,
    Skin,
    TaxelGrid,
    Tube,
    build_skin,
    load_skin,
)
from eskin.touch import Reading

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
STEP = 0.02  # [s] between the readings of a scene
# Threads that wait for each other on a busy machine cost more than they bring here.
torch.set_num_threads(1)

MIRROR = np.diag([-1.0, 1.0, 1.0, 1.0])


@dataclass(frozen=True, eq=False)
class Scene:
    """One touch through a few readings; what is pressed at all is active."""

    mounted: MountedSkin
    readings: tuple[Reading, ...]

    def graphs(self, config: GraphConfig | None = None) -> GraphBatch:
        """One graph a reading."""
        builder = GraphBuilder(self.mounted, config)
        earlier, batches = np.empty(0, np.int64), []
        for reading in self.readings:
            now = np.flatnonzero(reading.pressure > 0)
            builder.advance(reading, now)
            batches.append(builder.build(now, earlier))
            earlier = now
        return join_graphs(batches)


def reading_at(seconds, pressure, q=(), shear=None) -> Reading:
    stamp = START + round(seconds * SECOND)
    pressure = np.asarray(pressure, np.float32)
    valid = np.ones(len(pressure), bool)
    return Reading(stamp, pressure, valid, np.array(q, np.float64), shear)


def scene(mounted, pressures, qs=None, shear=False, step=STEP) -> Scene:
    """Readings `step` apart; shear, if any, turns with time and taxel."""
    readings = []
    for index, pressure in enumerate(np.asarray(pressures, np.float32)):
        drag = None
        if shear:
            angle = 0.3 * index + mounted.skin.rows + 0.5 * mounted.skin.columns
            drag = 0.5 * pressure[:, None] * np.stack([np.cos(angle), np.sin(angle)], 1)
            drag = drag.astype(np.float32)
        q = np.zeros(len(mounted.robot.joint_names)) if qs is None else qs[index]
        readings.append(reading_at(index * step, pressure, q, drag))
    return Scene(mounted, tuple(readings))


def bump(skin: Skin, centre, kpa=30.0, radius=0.02) -> np.ndarray:
    """Pressure [kPa] that falls off from `centre` in the link's frame [m]."""
    distance = np.linalg.norm(skin.positions - np.asarray(centre), axis=1)
    return kpa * np.maximum(1 - (distance / radius) ** 2, 0.0)


def table(skin: Skin) -> MountedSkin:
    return MountedSkin(skin, load_robot("table"))


def flat(rows=9, columns=9, pitch=0.01, patches=1, calibrated=True) -> MountedSkin:
    """Regular grids in the plane z = 0, side by side along x at the same pitch."""
    laid = []
    for n in range(patches):
        place = np.eye(4)
        place[0, 3] = (n - (patches - 1) / 2) * columns * pitch
        patch = Patch(f"p{n}", "table", n, rows, columns, "shear")
        laid.append((patch, TaxelGrid(rows, columns, pitch, pitch), Plane(place)))
    return table(build_skin("flat", laid, calibrated))


def rolled(radius=0.03, rows=9, columns=15, pitch=0.01) -> MountedSkin:
    """The grid that `flat` lays out, round a tube."""
    patch = Patch("p0", "table", 0, rows, columns, "shear")
    grid = TaxelGrid(rows, columns, pitch, pitch)
    return table(build_skin("rolled", [(patch, grid, Tube(radius, np.eye(4)))]))


def book() -> MountedSkin:
    """Two patches, 4 cm apart when the hinge is open; closed (q = pi) they face."""
    laid = []
    for n, (link, x, z) in enumerate([("cover", -0.05, 0.0), ("page", 0.05, -0.01)]):
        place = np.eye(4)
        place[[0, 2], 3] = x, z
        laid.append(
            (
                Patch(link, link, n, 7, 7, "shear"),
                TaxelGrid(7, 7, 0.01, 0.01),
                Plane(place),
            )
        )
    y = np.array([0.0, 1.0, 0.0])
    hinge = Joint("hinge", "revolute", "cover", "page", np.eye(4), y)
    robot = Robot("book", (Link("cover"), Link("page")), (hinge,))
    return MountedSkin(build_skin("book", laid), robot)


@cache
def on_flat_skins(shear: bool) -> torch.Tensor:
    """Summaries of touches on flat grids, where some features never change."""
    flat_scenes = press_on_grid, press_on_seam, stroke_on_grid
    batch = join_graphs([make(shear).graphs() for make in flat_scenes])
    return torch.as_tensor(compute_summary(batch, shear))


@cache
def ur5() -> MountedSkin:
    return MountedSkin(load_skin("ur5"), load_robot("ur5"))


FOLDED = np.array([-0.98, -0.44, 2.93, 0.39, -1.52, -1.62])
"""Wrist 3 of the ur5 lies against its upper arm."""


def press_on_grid(shear=False) -> Scene:
    """A load in the middle of a regular grid, the same on all sides, coming and going.

    Every active taxel has ties among its neighbours.
    """
    mounted = flat()
    shape = bump(mounted.skin, (0, 0, 0), kpa=1.0, radius=0.031)
    return scene(mounted, [k * shape for k in (10, 25, 60, 40, 0)], shear=shear)


def press_on_seam(shear=False) -> Scene:
    """A load over the corner of four taxels where two patches of one grid meet."""
    mounted = flat(patches=2, rows=8, columns=8)
    shape = bump(mounted.skin, (0, 0, 0), kpa=1.0, radius=0.033)
    return scene(mounted, [k * shape for k in (10, 25, 60, 40, 0)], shear=shear)


def press_in_book(shear=False) -> Scene:
    """A hand between two patches that close on each other."""
    mounted = book()
    shape = bump(mounted.skin, (-0.05, 0, 0), kpa=40.0, radius=0.025)
    shape += bump(mounted.skin, (0.05, 0, -0.01), kpa=30.0, radius=0.015)
    qs = np.linspace(2.9, np.pi, 4)[:, None]
    return scene(mounted, [k * shape for k in (0.3, 0.8, 1.0, 0.4)], qs, shear)


def touch_on_arm(shear=False) -> Scene:
    """A hand holding wrist 3 against the upper arm of a moving ur5."""
    mounted = ur5()
    skin = mounted.skin
    p_world, _ = mounted.place_taxels(FOLDED)
    links = np.array(skin.link_names)[skin.patch_index]
    wrist, arm = (
        np.flatnonzero(links == n) for n in ("wrist_3_link", "upper_arm_link")
    )
    gap = np.linalg.norm(p_world[wrist][:, None] - p_world[arm][None], axis=2)
    i, j = np.unravel_index(gap.argmin(), gap.shape)
    shape = (links == "wrist_3_link") * bump(skin, skin.positions[wrist[i]])
    shape += (links == "upper_arm_link") * bump(skin, skin.positions[arm[j]], 50.0)
    qs = FOLDED + 0.005 * np.arange(4)[:, None]
    return scene(mounted, [k * shape for k in (0.3, 1.0, 0.8, 0.1)], qs, shear)


def stroke_on_grid(shear=False, speed=0.2) -> Scene:
    """A load that moves along a grid at `speed` [m/s]."""
    mounted = flat(rows=7, columns=15)
    x = -0.03 + speed * STEP * np.arange(10)
    return scene(mounted, [bump(mounted.skin, (at, 0.003, 0)) for at in x], shear=shear)


SCENES = {
    "a press in the middle of a regular grid": press_on_grid,
    "a press on the seam of two patches": press_on_seam,
    "a hand between patches on two links": press_in_book,
    "a hand on two links of the ur5": touch_on_arm,
}


def motion(seed=0, far=2.0) -> np.ndarray:
    """A random rotation and translation [m], 4 x 4."""
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3] = orthogonal(rng, 1)
    T[:3, 3] = far * rng.standard_normal(3)
    return T


def orthogonal(rng, sign: int) -> np.ndarray:
    """A random orthogonal matrix, with a determinant of 1 or -1."""
    Q, R = np.linalg.qr(rng.standard_normal((3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q * (sign * np.sign(np.linalg.det(Q)))


def moved(before: Scene, T_world_base: np.ndarray) -> Scene:
    """The whole robot elsewhere."""
    robot = before.mounted.robot
    (root,) = set(robot.link_names) - {joint.child for joint in robot.joints}
    stand = Joint("stand", "fixed", "floor", root, T_world_base, np.eye(3)[2])
    links, joints = (Link("floor"), *robot.links), (stand, *robot.joints)
    mounted = MountedSkin(before.mounted.skin, Robot("moved", links, joints))
    return Scene(mounted, before.readings)


def mirrored(before: Scene) -> Scene:
    """The whole robot, its joints' axes and its skin as a mirror shows them."""
    M = MIRROR[:3, :3]
    skin, robot = before.mounted.skin, before.mounted.robot
    vectors = ("positions", "normals", "tangents")
    skin = replace(skin, **{name: getattr(skin, name) @ M for name in vectors})
    joints = tuple(
        # A turn is seen the other way round.
        replace(j, T_parent_joint=MIRROR @ j.T_parent_joint @ MIRROR, axis=-M @ j.axis)
        for j in robot.joints
    )
    mounted = MountedSkin(skin, Robot("mirrored", robot.links, joints))
    # The taxel's y axis stays right-handed, so what is seen along it changes sign.
    flip = np.array([1.0, -1.0], np.float32)
    readings = tuple(
        r if r.shear is None else replace(r, shear=r.shear * flip)
        for r in before.readings
    )
    return Scene(mounted, readings)


def renumbered(before: Scene, seed=0) -> Scene:
    """The same with taxels and patches in another order."""
    rng = np.random.default_rng(seed)
    skin = before.mounted.skin
    taxels, patches = rng.permutation(skin.count), rng.permutation(len(skin.patches))
    names = ("rows", "columns", "positions", "normals", "areas", "tangents")
    other = replace(
        skin,
        patches=tuple(skin.patches[n] for n in patches),
        patch_index=np.argsort(patches)[skin.patch_index[taxels]],
        **{name: getattr(skin, name)[taxels] for name in names},
    )
    readings = tuple(
        replace(
            r,
            pressure=r.pressure[taxels],
            valid=r.valid[taxels],
            shear=None if r.shear is None else r.shear[taxels],
        )
        for r in before.readings
    )
    return Scene(MountedSkin(other, before.mounted.robot), readings)


FLOATS = tuple(
    field.name
    for field in fields(GraphBatch)
    if field.name not in ("taxels", "neighbours", "offsets")
)


def double(batch: GraphBatch) -> GraphBatch:
    """The same graphs in float64."""
    values = {name: getattr(batch, name).astype(np.float64) for name in FLOATS}
    return replace(batch, **values)


def turned(batch: GraphBatch, Q: np.ndarray, shift=(0.0, 0.0, 0.0)) -> GraphBatch:
    """Every vector turned (or mirrored) by Q, and positions shifted [cm]."""
    dtype = batch.positions.dtype
    vectors = ("positions", "normals", "shear", "shear_before")
    parts = {name: (getattr(batch, name) @ Q.T).astype(dtype) for name in vectors}
    parts["positions"] = parts["positions"] + np.asarray(shift, dtype)
    return replace(batch, **parts)


def shuffled(batch: GraphBatch, rng) -> GraphBatch:
    """The nodes of each graph in another order, and the sources of each edge too."""
    parts = []
    for graph in range(batch.count):
        one = batch.select(np.array([graph]))
        order = rng.permutation(len(one.taxels))
        place = np.append(np.argsort(order), -1)
        nodes = {
            field.name: getattr(one, field.name)[order]
            for field in fields(GraphBatch)
            if field.name not in ("offsets", "seconds", "history", "neighbours")
        }
        neighbours = place[one.neighbours[order]]
        neighbours = rng.permuted(neighbours, axis=1)
        parts.append(replace(one, neighbours=neighbours, **nodes))
    return join_graphs(parts)


def with_bystanders(batch: GraphBatch, rng, count=3) -> GraphBatch:
    """Beside each graph some nodes at rest, which hear others but are not heard."""
    nothing = ("pressure", "before", "age", "shear", "shear_before")
    parts = []
    for graph in range(batch.count):
        one, others = batch.select(np.array([graph])), random_graph(rng, count)
        bounds = np.array([0, len(one.taxels) + count])
        changes = {"offsets": bounds, "seconds": one.seconds, "history": one.history}
        for name in (f.name for f in fields(GraphBatch) if f.name not in changes):
            mine, theirs = getattr(one, name), getattr(others, name)
            if name == "neighbours":
                theirs = rng.integers(-1, bounds[1], (count, mine.shape[1]))
            if name in nothing:
                theirs = np.zeros_like(theirs)
            changes[name] = np.concatenate([mine, theirs.astype(mine.dtype)])
        parts.append(GraphBatch(**changes))
    return join_graphs(parts)


def random_graph(rng, nodes: int, neighbours=6) -> GraphBatch:
    """A graph of float32 that no skin ever gave."""

    def real(*shape):
        return rng.normal(size=shape).astype(np.float32)

    pressure, normals = np.maximum(20 * real(nodes), 0), real(nodes, 3)
    return GraphBatch(
        taxels=np.arange(nodes),
        pressure=pressure,
        before=np.maximum(20 * real(nodes), 0),
        age=np.abs(real(nodes)) * (pressure > 0),
        areas=np.abs(real(nodes)) + np.float32(0.1),
        positions=2 * real(nodes, 3),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        shear=10 * real(nodes, 3) * (pressure > 0)[:, None],
        shear_before=10 * real(nodes, 3),
        neighbours=rng.integers(-1, max(nodes, 1), (nodes, neighbours)),
        offsets=np.array([0, nodes]),
        seconds=np.array([0.02], np.float32),
        history=np.abs(real(1, len(HISTORY))),
    )


def assert_same(one: GraphBatch, other: GraphBatch) -> None:
    """Equal to the last bit, and of the same types."""
    for field in fields(GraphBatch):
        a, b = getattr(one, field.name), getattr(other, field.name)
        assert np.array_equal(a, b), field.name
        assert a.dtype.kind == b.dtype.kind and a.shape == b.shape, field.name


def pressure_summary(batch: GraphBatch) -> np.ndarray:
    return compute_summary(batch, shear=False)


def shear_summary(batch: GraphBatch) -> np.ndarray:
    return compute_summary(batch, shear=True)[:, len(PRESSURE_SUMMARY) :]


def network_input(batch, window, slot, windows, shear, dtype=torch.float32):
    """The features of a batch of graphs, and the slot of each in its window."""
    index = SlotIndex(torch.as_tensor(window), torch.as_tensor(slot), windows)
    return NetworkInput(build_graph_tensors(batch, shear, dtype), index)


def window_of(net, batch, dtype=torch.float32):
    """The network's input where the graphs are the last readings of one window."""
    slot = np.arange(batch.count) + net.config.slots - batch.count
    window = np.zeros(batch.count, np.int64)
    return network_input(batch, window, slot, 1, net.shear, dtype)


def logits(net, batch, dtype=torch.float32) -> np.ndarray:
    """Logits of the one window that the graphs make."""
    with torch.no_grad():
        return net.to(dtype)(window_of(net, batch, dtype))[0].numpy()
