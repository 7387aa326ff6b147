"""This module unrolls skins that lie on no plane, tube or dome.

The taxels of a link and their normals are a mesh of its surface: each taxel is joined
to those around it. A sheet is the part around one patch, unrolled by the discrete
exponential map (Schmidt et al. 2006, averaged as in Schmidt 2013), with the curvature
of the mesh at every taxel.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import final

import numpy as np
from jaxtyping import Float, Int
from scipy.spatial import KDTree

from eskin.sim.contact.kernels import unroll_mesh
from eskin.skin import Skin, Surface, SurfacePoints
from eskin.skin.surfaces import Points, Unrolled
from eskin.transforms import make_transform

REACH = 2.6
"""Distance up to which taxels are joined, in sides of a square of their area."""
ADJOINING = 1.6
"""Distance up to which taxels of one patch are unrolled from each other, in such sides.
"""
GAP = 0.03
"""Distance up to which taxels of patches beside each other are joined [m]."""
MIN_COSINE = -0.1
"""Smallest cosine between the normals of joined taxels: a sharp edge is passed, a thin
plate is not."""
BEYOND = 0.15
"""Distance that a sheet goes on beyond its patch [m]."""
BLENDED = 4
"""Number of taxels whose own maps are blended at a point."""
MAX_CURVATURE = 200.0
"""Largest curvature [1/m]."""
MAX_STEP = 0.02
"""Distance from a taxel up to which its curvature counts [m]."""
LENGTH_SHARE = 0.05
"""Weight of the extent of a sheet, over the weight of its normals, in its axis."""


@dataclass(frozen=True, eq=False)
class SkinMesh:
    """A skin mesh joins each taxel to those around it on the same link."""

    positions: Float[np.ndarray, "taxel 3"]
    """Centres in the frames of their links [m]."""
    normals: Float[np.ndarray, "taxel 3"]
    """Outward unit normals in those frames."""
    sides: Float[np.ndarray, "taxel"]
    """Side of a square of each taxel's area [m]."""
    starts: Int[np.ndarray, "taxel_and_one"]
    """First of each taxel's entries in `joined`."""
    joined: Int[np.ndarray, "entry"]
    """Taxels that a taxel is joined to."""
    curvatures: Float[np.ndarray, "taxel 3 3"]
    """Change of the unit normal along the surface [1/m], positive where convex."""


@final
@dataclass(frozen=True, eq=False)
class Sheet(Surface):
    """A sheet is the surface around one patch; (0, 0) lies in the middle of the patch.

    Near each taxel it is the paraboloid of the curvature there; in between, those of
    the nearest taxels are blended. t runs along the sheet where it is bent least.
    """

    positions: Points
    """Centres of the taxels in the frame of the link [m]."""
    normals: Points
    """Outward unit normals."""
    flat: Unrolled
    """Unrolled coordinates (s, t) of the taxels [m]."""
    axes: Float[np.ndarray, "taxel 2 3"]
    """Unit directions of s and of t at each taxel."""
    curvatures: Float[np.ndarray, "taxel 2 2"]
    """Curvature along s and t [1/m], positive where convex."""
    sides: Float[np.ndarray, "taxel"]
    """Side of a square of each taxel's area [m]."""
    T_link_surface: Float[np.ndarray, "4 4"]
    """Pose of the middle: x along s, y along t, z outward."""

    @cached_property
    def in_plane(self) -> KDTree:
        """Return the tree of the unrolled taxels."""
        return KDTree(self.flat)

    @cached_property
    def on_link(self) -> KDTree:
        """Return the tree of the taxels on the link."""
        return KDTree(self.positions)

    def wrap(self, unrolled: Unrolled) -> SurfacePoints:
        """Lay unrolled points (s, t) [m] on the surface."""
        taxels, weights = find_nearest(self.in_plane, unrolled)
        offset = unrolled[:, None] - self.flat[taxels]
        length = np.linalg.norm(offset, axis=-1, keepdims=True)
        bent = offset * np.minimum(1.0, MAX_STEP / np.maximum(length, 1e-12))
        tilt = np.einsum("pkij,pkj->pki", self.curvatures[taxels], bent)
        axes = self.axes[taxels]
        normals = self.normals[taxels]
        drop = 0.5 * np.sum(tilt * bent, axis=2, keepdims=True)
        drop += np.sum(tilt * (offset - bent), axis=2, keepdims=True)
        along = np.einsum("pki,pkij->pkj", offset, axes)
        places = self.positions[taxels] + along - drop * normals
        leaning = normals + np.einsum("pki,pkij->pkj", tilt, axes)
        leaning /= np.linalg.norm(leaning, axis=2, keepdims=True)
        normal = normalise(np.einsum("pk,pkj->pj", weights, leaning))
        tangent = np.einsum("pk,pkj->pj", weights, axes[:, :, 0])
        tangent -= np.sum(tangent * normal, axis=1, keepdims=True) * normal
        return SurfacePoints(
            positions=np.einsum("pk,pkj->pj", weights, places),
            normals=normal,
            tangents=normalise(tangent),
            area_scale=np.ones(len(unrolled)),
        )

    def unroll(self, positions: Points) -> Unrolled:
        """Return the unrolled coordinates (s, t) [m] of points on the surface [m]."""
        taxels, weights = find_nearest(self.on_link, positions)
        offset = positions[:, None] - self.positions[taxels]
        places = self.flat[taxels] + np.einsum(
            "pkij,pkj->pki", self.axes[taxels], offset
        )
        return np.einsum("pk,pki->pi", weights, places)

    def compute_curvature(
        self, unrolled: Float[np.ndarray, "*batch 2"]
    ) -> Float[np.ndarray, "*batch 2 2"]:
        """Return the curvature along s and t at the taxel nearest to points [1/m]."""
        return self.curvatures[self.in_plane.query(unrolled)[1]]

    def is_beyond(
        self, unrolled: Float[np.ndarray, "*batch 2"], rim: float
    ) -> np.ndarray:
        """Tell which points (s, t) lie more than a rim [m] beside all cells."""
        distance, taxel = self.in_plane.query(unrolled)
        return distance > rim + self.sides[taxel] / 2


def find_nearest(
    tree: KDTree, points: Float[np.ndarray, "point dim"]
) -> tuple[Int[np.ndarray, "point near"], Float[np.ndarray, "point near"]]:
    """Find the taxels nearest to points, and their weights, which sum to 1.

    Weights fall with the fourth power of the distance, so a taxel's own place is its.
    """
    count = min(BLENDED, tree.n)
    distance, taxels = map(np.atleast_1d, tree.query(points, k=count))
    distance, taxels = (each.reshape(-1, count) for each in (distance, taxels))
    weights = 1.0 / np.maximum(distance, 1e-9) ** 4
    return taxels, weights / weights.sum(axis=1, keepdims=True)


def normalise(vectors: Points) -> Points:
    """Return vectors scaled to length 1."""
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-12)


def build_skin_mesh(skin: Skin) -> SkinMesh:
    """Join the taxels of a skin, and compute the curvature at each of them."""
    sides = np.sqrt(skin.areas)
    links = np.array(skin.link_names)[skin.patch_index]
    pairs = [np.zeros((0, 2), dtype=np.int64)]
    for link in dict.fromkeys(skin.link_names):
        here = np.flatnonzero(links == link)
        reach = np.maximum(REACH * sides[here], GAP)
        tree = KDTree(skin.positions[here])
        near = tree.query_pairs(float(reach.max(initial=0.0)), output_type="ndarray")
        a, b = here[near].T
        distance = np.linalg.norm(skin.positions[a] - skin.positions[b], axis=1)
        cosine = np.sum(skin.normals[a] * skin.normals[b], axis=1)
        close = distance <= np.maximum(reach[near[:, 0]], reach[near[:, 1]])
        pairs.append(here[near[close & (cosine > MIN_COSINE)]])
    both = np.concatenate(
        [each[:, order] for each in pairs for order in ([0, 1], [1, 0])]
    )
    both = both[np.lexsort(both.T[::-1])]
    curvatures = compute_curvatures(skin, both, sides)
    i, j = both.T
    distance = np.linalg.norm(skin.positions[i] - skin.positions[j], axis=1)
    adjoining = distance <= ADJOINING * np.maximum(sides[i], sides[j])
    both = both[adjoining | (skin.patch_index[i] != skin.patch_index[j])]
    starts = np.searchsorted(both[:, 0], np.arange(skin.count + 1))
    return SkinMesh(
        skin.positions, skin.normals, sides, starts, both[:, 1].copy(), curvatures
    )


def compute_curvatures(
    skin: Skin, pairs: Int[np.ndarray, "pair 2"], sides: Float[np.ndarray, "taxel"]
) -> Float[np.ndarray, "taxel 3 3"]:
    """Compute the curvature at each taxel, as a tensor in its link's frame [1/m].

    It is the symmetric tensor that changes the normals as they do from a taxel to those
    within `REACH` around it, by least squares (as in Rusinkiewicz 2004).
    """
    first = np.cross(skin.normals, skin.tangents)
    second = skin.tangents
    axes = np.stack([second, first], axis=1)
    i, j = pairs.T
    step = skin.positions[j] - skin.positions[i]
    near = np.linalg.norm(step, axis=1) <= REACH * np.maximum(sides[i], sides[j])
    i = i[near]
    j = j[near]
    step = step[near]
    x, y = np.einsum("pij,pj->pi", axes[i], step).T
    u, v = np.einsum("pij,pj->pi", axes[i], skin.normals[j] - skin.normals[i]).T
    # Two equations for each pair: u = k0 x + k1 y and v = k1 x + k2 y.
    zero = np.zeros_like(x)
    rows = np.stack(
        [np.stack([x, y, zero], axis=1), np.stack([zero, x, y], axis=1)], axis=1
    )
    squares = np.zeros((skin.count, 3, 3))
    products = np.zeros((skin.count, 3))
    np.add.at(squares, i, np.einsum("pri,prj->pij", rows, rows))
    np.add.at(products, i, np.einsum("pri,pr->pi", rows, np.stack([u, v], axis=1)))
    # A taxel with too few around it is flat across the directions that none shows.
    ridge = np.maximum(1e-3 * np.trace(squares, axis1=1, axis2=2), 1e-12)
    squares += ridge[:, None, None] * np.eye(3)
    k0, k1, k2 = np.linalg.solve(squares, products[..., None])[..., 0].T
    tensors = np.stack([np.stack([k0, k1], -1), np.stack([k1, k2], -1)], -2)
    values, vectors = np.linalg.eigh(tensors)
    values = np.clip(values, -MAX_CURVATURE, MAX_CURVATURE)
    tensors = np.einsum("tij,tj,tkj->tik", vectors, values, vectors)
    return np.einsum("tia,tij,tjb->tab", axes, tensors, axes)


def build_sheet(
    mesh: SkinMesh, own: Int[np.ndarray, "own"]
) -> tuple[Sheet, Int[np.ndarray, "part"]]:
    """Build the sheet around the taxels of a patch, and the taxels that lie on it.

    `own` holds the taxels of the patch, ascending.
    """
    middle = mesh.positions[own].mean(axis=0)
    away = np.linalg.norm(mesh.positions[own] - middle, axis=1)
    centre = int(own[np.argmin(away)])
    reach = float(away.max() + BEYOND)
    normal = mesh.normals[centre]
    least = np.eye(3)[np.argmin(np.abs(normal))]
    first = np.cross(least, normal)
    first /= np.linalg.norm(first)
    start = np.stack([first, np.cross(normal, first)])
    reached, flat, axes = unroll_mesh(
        mesh.positions, mesh.normals, mesh.starts, mesh.joined, centre, start, reach
    )
    taxels = np.union1d(np.flatnonzero(reached), own)
    lost = taxels[~reached[taxels]]
    # A part of the patch that no taxel leads to is projected onto the middle.
    flat[lost] = (mesh.positions[lost] - mesh.positions[centre]) @ start.T
    axes[lost] = project_axes(start, mesh.normals[lost])
    turn = find_turn(mesh.positions[taxels], mesh.normals[taxels], start)
    axes = np.einsum("ij,tjk->tik", turn, axes[taxels])
    tensors = np.einsum("tia,tab,tjb->tij", axes, mesh.curvatures[taxels], axes)
    frame = np.column_stack([*(turn @ start), normal])
    return Sheet(
        positions=mesh.positions[taxels],
        normals=mesh.normals[taxels],
        flat=flat[taxels] @ turn.T,
        axes=axes,
        curvatures=tensors,
        sides=mesh.sides[taxels],
        T_link_surface=make_transform(frame, mesh.positions[centre]),
    ), taxels


def project_axes(
    axes: Float[np.ndarray, "2 3"], normals: Float[np.ndarray, "taxel 3"]
) -> Float[np.ndarray, "taxel 2 3"]:
    """Return the axes nearest to two unit vectors that are perpendicular to normals."""
    across = axes[0] - (normals @ axes[0])[:, None] * normals
    short = np.linalg.norm(across, axis=1) < 0.1
    across[short] = (axes[1] - (normals @ axes[1])[:, None] * normals)[short]
    first = normalise(across)
    return np.stack([first, np.cross(normals, first)], axis=1)


def find_turn(
    positions: Points, normals: Points, start: Float[np.ndarray, "2 3"]
) -> Float[np.ndarray, "2 2"]:
    """Find the rotation in the plane that lays t along the axis of a sheet.

    The axis is the direction to which the normals are most perpendicular, as that of a
    limb; of directions that are alike, it is the one along which the sheet is longest.
    """
    spread = positions - positions.mean(axis=0)
    extent = spread.T @ spread
    bent = normals.T @ normals / len(normals)
    cost = bent - LENGTH_SHARE * extent / max(float(np.trace(extent)), 1e-12)
    along = start @ cost @ start.T
    axis = np.linalg.eigh(along)[1][:, 0]
    axis = axis if axis[np.argmax(np.abs(axis))] > 0 else -axis
    return np.array([[axis[1], -axis[0]], [axis[0], axis[1]]])
