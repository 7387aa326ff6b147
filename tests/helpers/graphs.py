"""These helpers build touches on small skins and on the ur5, and change them.

A scene can be moved, mirrored and renumbered; graphs can be rotated and shuffled.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import torch

from eskin.learn.nn import NetworkInput, SlotIndex, build_graph_tensors
from eskin.live import (
    HISTORY,
    NODE_FIELDS,
    PRESSURE_SUMMARY,
    GraphBatch,
    GraphBuilder,
    GraphConfig,
    compute_summary,
    join_graphs,
)
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
LOADS = ("pressure", "before", "age", "shear", "shear_before")
"""Fields of a graph that are zero at a node at rest."""


@dataclass(frozen=True, eq=False)
class Scene:
    """One touch through a few readings; every taxel with pressure is active."""

    mounted: MountedSkin
    readings: tuple[Reading, ...]

    def graphs(self, config: GraphConfig | None = None) -> GraphBatch:
        """Return one graph for each reading."""
        builder = GraphBuilder(self.mounted, config)
        earlier = np.empty(0, np.int64)
        batches = []
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


def make_scene(mounted, pressures, qs=None, shear=False, step=STEP) -> Scene:
    """Build readings `step` apart; shear, if any, turns with time and taxel."""
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
    """Return pressure [kPa] that falls off from `centre` in the link's frame [m]."""
    distance = np.linalg.norm(skin.positions - np.asarray(centre), axis=1)
    return kpa * np.maximum(1 - (distance / radius) ** 2, 0.0)


def mount(name, *laid, calibrated=True) -> MountedSkin:
    """Mount a skin of patches laid on surfaces on the table."""
    return MountedSkin(build_skin(name, list(laid), calibrated), load_robot("table"))


def flat(rows=9, columns=9, pitch=0.01, patches=1, calibrated=True) -> MountedSkin:
    """Build regular grids in the plane z = 0, side by side along x."""
    laid = []
    for n in range(patches):
        place = np.eye(4)
        place[0, 3] = (n - (patches - 1) / 2) * columns * pitch
        patch = Patch(f"p{n}", "table", n, rows, columns, "shear")
        laid.append((patch, TaxelGrid(rows, columns, pitch, pitch), Plane(place)))
    return mount("flat", *laid, calibrated=calibrated)


def rolled(radius=0.03, rows=9, columns=15, pitch=0.01) -> MountedSkin:
    """Build the grid of `flat` around a tube."""
    patch = Patch("p0", "table", 0, rows, columns, "shear")
    grid = TaxelGrid(rows, columns, pitch, pitch)
    return mount("rolled", (patch, grid, Tube(radius, np.eye(4))))


def book() -> MountedSkin:
    """Build two patches, 4 cm apart at q = 0, that face each other at q = pi."""
    laid = []
    grid = TaxelGrid(7, 7, 0.01, 0.01)
    for n, (link, x, z) in enumerate([("cover", -0.05, 0.0), ("page", 0.05, -0.01)]):
        place = np.eye(4)
        place[[0, 2], 3] = x, z
        laid.append((Patch(link, link, n, 7, 7, "shear"), grid, Plane(place)))
    y = np.array([0.0, 1.0, 0.0])
    hinge = Joint("hinge", "revolute", "cover", "page", np.eye(4), y)
    robot = Robot("book", (Link("cover"), Link("page")), (hinge,))
    return MountedSkin(build_skin("book", laid), robot)


@cache
def ur5() -> MountedSkin:
    return MountedSkin(load_skin("ur5"), load_robot("ur5"))


FOLDED = np.array([-0.98, -0.44, 2.93, 0.39, -1.52, -1.62])
"""Wrist 3 of the ur5 lies against its upper arm."""


def find_meeting_taxels() -> tuple[int, int]:
    """Return the taxels of wrist 3 and the upper arm that meet in `FOLDED`."""
    links = np.array(ur5().skin.link_names)[ur5().skin.patch_index]
    p_world, _ = ur5().place_taxels(FOLDED)
    wrist, arm = (
        np.flatnonzero(links == f"{n}_link") for n in ("wrist_3", "upper_arm")
    )
    gap = np.linalg.norm(p_world[wrist][:, None] - p_world[arm][None], axis=2)
    i, j = np.unravel_index(gap.argmin(), gap.shape)
    return int(wrist[i]), int(arm[j])


def press_on_grid(shear=False) -> Scene:
    """Press the middle of a regular grid, with ties among all neighbours."""
    mounted = flat()
    shape = bump(mounted.skin, (0, 0, 0), kpa=1.0, radius=0.031)
    return make_scene(mounted, [k * shape for k in (10, 25, 60, 40, 0)], shear=shear)


def press_on_seam(shear=False) -> Scene:
    """Press the corner of four taxels where two patches of one grid meet."""
    mounted = flat(patches=2, rows=8, columns=8)
    shape = bump(mounted.skin, (0, 0, 0), kpa=1.0, radius=0.033)
    return make_scene(mounted, [k * shape for k in (10, 25, 60, 40, 0)], shear=shear)


def press_in_book(shear=False) -> Scene:
    """Press between two patches that close on each other."""
    mounted = book()
    shape = bump(mounted.skin, (-0.05, 0, 0), kpa=40.0, radius=0.025)
    shape += bump(mounted.skin, (0.05, 0, -0.01), kpa=30.0, radius=0.015)
    qs = np.linspace(2.9, np.pi, 4)[:, None]
    return make_scene(mounted, [k * shape for k in (0.3, 0.8, 1.0, 0.4)], qs, shear)


def touch_on_arm(shear=False) -> Scene:
    """Hold wrist 3 against the upper arm of a moving ur5."""
    skin = ur5().skin
    links = np.array(skin.link_names)[skin.patch_index]
    shape = np.zeros(skin.count)
    for taxel, kpa in zip(find_meeting_taxels(), (30.0, 50.0), strict=True):
        shape += (links == links[taxel]) * bump(skin, skin.positions[taxel], kpa)
    qs = FOLDED + 0.005 * np.arange(4)[:, None]
    return make_scene(ur5(), [k * shape for k in (0.3, 1.0, 0.8, 0.1)], qs, shear)


def stroke_on_grid(shear=False, speed=0.2) -> Scene:
    """Move a load along a grid at `speed` [m/s]."""
    mounted = flat(rows=7, columns=15)
    x = -0.03 + speed * STEP * np.arange(10)
    loads = [bump(mounted.skin, (at, 0.003, 0)) for at in x]
    return make_scene(mounted, loads, shear=shear)


SCENES = {
    "grid": press_on_grid,
    "seam of two patches": press_on_seam,
    "patches on two links": press_in_book,
    "two links of the ur5": touch_on_arm,
}


def motion(seed=0, far=2.0) -> np.ndarray:
    """Return a random rotation and translation [m], 4 x 4."""
    rng = np.random.default_rng(seed)
    T = np.eye(4)
    T[:3, :3] = orthogonal(rng, 1)
    T[:3, 3] = far * rng.standard_normal(3)
    return T


def orthogonal(rng, sign: int) -> np.ndarray:
    """Return a random orthogonal matrix, with a determinant of 1 or -1."""
    Q, R = np.linalg.qr(rng.standard_normal((3, 3)))
    Q = Q * np.sign(np.diag(R))
    return Q * (sign * np.sign(np.linalg.det(Q)))


def move_scene(before: Scene, T_world_base: np.ndarray) -> Scene:
    """Return the scene with the whole robot elsewhere."""
    robot = before.mounted.robot
    (root,) = set(robot.link_names) - {joint.child for joint in robot.joints}
    stand = Joint("stand", "fixed", "floor", root, T_world_base, np.eye(3)[2])
    links = (Link("floor"), *robot.links)
    joints = (stand, *robot.joints)
    mounted = MountedSkin(before.mounted.skin, Robot("moved", links, joints))
    return Scene(mounted, before.readings)


def mirror_scene(before: Scene) -> Scene:
    """Return the mirror image of the robot, its joints' axes and its skin."""
    M = MIRROR[:3, :3]
    skin = before.mounted.skin
    robot = before.mounted.robot
    vectors = ("positions", "normals", "tangents")
    skin = replace(skin, **{name: getattr(skin, name) @ M for name in vectors})
    # A mirror reverses rotations.
    joints = tuple(
        replace(j, T_parent_joint=MIRROR @ j.T_parent_joint @ MIRROR, axis=-M @ j.axis)
        for j in robot.joints
    )
    mounted = MountedSkin(skin, Robot("mirrored", robot.links, joints))
    # The taxel's axes stay right-handed, so shear along y changes its sign.
    flip = np.array([1.0, -1.0], np.float32)
    drags = [None if r.shear is None else r.shear * flip for r in before.readings]
    pairs = zip(before.readings, drags, strict=True)
    return Scene(mounted, tuple(replace(r, shear=drag) for r, drag in pairs))


def renumber_scene(before: Scene, seed=0) -> Scene:
    """Return the scene with taxels and patches in another order."""
    rng = np.random.default_rng(seed)
    skin = before.mounted.skin
    taxels = rng.permutation(skin.count)
    patches = rng.permutation(len(skin.patches))
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


def split_graphs(batch: GraphBatch) -> list[GraphBatch]:
    return [batch.select(np.array([n])) for n in range(batch.size)]


def to_float64(batch: GraphBatch) -> GraphBatch:
    values = batch._asdict()
    real = {
        name: v.astype(np.float64) for name, v in values.items() if v.dtype.kind == "f"
    }
    return batch._replace(**real)


def turned(batch: GraphBatch, Q: np.ndarray, shift=(0.0, 0.0, 0.0)) -> GraphBatch:
    """Return the batch with all vectors times Q, and positions shifted [cm]."""
    dtype = batch.positions.dtype
    vectors = ("positions", "normals", "shear", "shear_before")
    parts = {name: (getattr(batch, name) @ Q.T).astype(dtype) for name in vectors}
    parts["positions"] = parts["positions"] + np.asarray(shift, dtype)
    return batch._replace(**parts)


def shuffle_nodes(batch: GraphBatch, rng) -> GraphBatch:
    """Return the nodes of each graph and the sources of each edge in another order."""
    parts = []
    for graph in split_graphs(batch):
        order = rng.permutation(len(graph.taxels))
        nodes = {name: getattr(graph, name)[order] for name in NODE_FIELDS}
        place = np.append(np.argsort(order), -1)
        nodes["neighbours"] = rng.permuted(place[nodes["neighbours"]], axis=1)
        parts.append(graph._replace(**nodes))
    return join_graphs(parts)


def add_nodes_at_rest(batch: GraphBatch, rng, count=3) -> GraphBatch:
    """Return each graph with more nodes at rest, which are no source of any edge."""
    parts = []
    for graph in split_graphs(batch):
        rest = random_graph(rng, count, graph.neighbours.shape[1])
        rest = rest._replace(**{name: 0 * getattr(rest, name) for name in LOADS})
        pairs = {n: (getattr(graph, n), getattr(rest, n)) for n in NODE_FIELDS}
        nodes = {
            n: np.concatenate([a, b.astype(a.dtype)]) for n, (a, b) in pairs.items()
        }
        bounds = np.array([0, len(nodes["taxels"])])
        parts.append(graph._replace(**nodes, offsets=bounds))
    return join_graphs(parts)


def random_graph(rng, nodes: int, neighbours=6) -> GraphBatch:
    """Return a graph in float32 that no skin would give."""

    def real(*shape):
        return rng.normal(size=shape).astype(np.float32)

    pressure = np.maximum(20 * real(nodes), 0)
    normals = real(nodes, 3)
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


def random_graphs(rng, sizes) -> GraphBatch:
    return join_graphs([random_graph(rng, int(nodes)) for nodes in sizes])


def assert_same(one: GraphBatch, other: GraphBatch) -> None:
    """Check that two batches are equal to the last bit, and of the same types."""
    for name in GraphBatch._fields:
        a = getattr(one, name)
        b = getattr(other, name)
        assert np.array_equal(a, b), name
        assert a.dtype.kind == b.dtype.kind and a.shape == b.shape, name


def pressure_summary(batch: GraphBatch) -> np.ndarray:
    return compute_summary(batch, shear=False)


def shear_summary(batch: GraphBatch) -> np.ndarray:
    return compute_summary(batch, shear=True)[:, len(PRESSURE_SUMMARY) :]


def network_input(batch, window, slot, windows, shear, dtype=torch.float32):
    """Return the features of a batch of graphs, with the slot of each in its window."""
    index = SlotIndex(torch.as_tensor(window), torch.as_tensor(slot), windows)
    return NetworkInput(build_graph_tensors(batch, shear, dtype), index)


def window_input(net, batch, dtype=torch.float32):
    """Return the network's input with the graphs as the last readings of one window."""
    slot = np.arange(batch.size) + net.config.slots - batch.size
    window = np.zeros(batch.size, np.int64)
    return network_input(batch, window, slot, 1, net.shear, dtype)


def logits(net, batch, dtype=torch.float32) -> np.ndarray:
    """Return the logits of the one window that the graphs make."""
    with torch.no_grad():
        return net.to(dtype)(window_input(net, batch, dtype))[0].numpy()


def embed(net, batch, dtype=torch.float32) -> np.ndarray:
    """Return the embedding that the encoder computes of each graph."""
    with torch.no_grad():
        return net.to(dtype).encoder(window_input(net, batch, dtype).graphs).numpy()
