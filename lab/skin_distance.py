"""Compute distances between taxels along the surface of the skin."""

from typing import final

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import dijkstra
from scipy.spatial import KDTree

from eskin.skin import Skin
from eskin.skin.surfaces import TOLERANCE, Dome, Surface, Tube, fit_surface

NEIGHBOURS = 8
SEAM = 0.03


@final
class GeometricDistance:
    """Computes distances along the surface of the skin, for any pose of the robot.

    Between taxels of one link on one plane, tube or dome it is the length of the
    shortest path on it, in closed form. Between others of a link it is the shortest
    path over neighbouring taxels, across the seams between patches that are near each
    other; such a path is up to 8 % too long on a square grid. Without a path, as
    between links, the distance is infinite.

    Attributes:
        skin: the skin.
        surfaces: planes, tubes and domes that were found on it.
        surface_index: index of each taxel's surface in `surfaces`, or -1.
    """

    def __init__(self, skin: Skin, seam: float = SEAM) -> None:
        """Find the surfaces and the neighbours.

        Args:
            skin: the skin.
            seam: longest step from a taxel of one patch to one of another [m].
        """
        self.skin = skin
        self.surfaces, self.surface_index = find_surfaces(skin)
        self.steps = self.build_graph(seam)

    def between(
        self, sources: Int[np.ndarray, "source"], targets: Int[np.ndarray, "target"]
    ) -> Float[np.ndarray, "source target"]:
        """Return the distance from each source taxel to each target taxel [m]."""
        distances = dijkstra(self.steps, directed=False, indices=sources)[:, targets]
        of_sources, of_targets = (
            self.surface_index[sources],
            self.surface_index[targets],
        )
        positions = self.skin.positions
        for number, surface in enumerate(self.surfaces):
            row, column = of_sources == number, of_targets == number
            distances[np.ix_(row, column)] = surface_distances(
                surface, positions[sources[row]], positions[targets[column]]
            )
        return distances

    def build_graph(self, seam: float) -> csr_array:
        """Build the graph of neighbouring taxels of a link, with distances [m]."""
        pairs = np.concatenate([self.find_patch_pairs(), self.find_seam_pairs(seam)])
        pairs = np.unique(np.sort(pairs, axis=1), axis=0)
        a, b = pairs.T
        lengths = np.linalg.norm(
            self.skin.positions[a] - self.skin.positions[b], axis=1
        )
        count = self.skin.count
        # A sparse graph has no edge where the length is 0.
        lengths = np.maximum(lengths, np.finfo(float).tiny)
        return coo_array((lengths, (a, b)), shape=(count, count)).tocsr()

    def find_patch_pairs(self) -> Int[np.ndarray, "pair 2"]:
        """Return pairs of each taxel and the nearest ones of its patch."""
        pairs = []
        for patch in range(len(self.skin.patches)):
            taxels = np.flatnonzero(self.skin.patch_index == patch)
            nearest = min(NEIGHBOURS + 1, len(taxels))
            if nearest < 2:
                continue
            points = self.skin.positions[taxels]
            near = np.asarray(KDTree(points).query(points, nearest)[1])
            own = np.repeat(taxels, nearest)
            pairs.append(np.column_stack([own, taxels[near.ravel()]]))
        joined = np.concatenate([np.zeros((0, 2), dtype=np.int64), *pairs])
        return joined[joined[:, 0] != joined[:, 1]]

    def find_seam_pairs(self, seam: float) -> Int[np.ndarray, "pair 2"]:
        """Return pairs of taxels of two patches of a link within the seam's width."""
        links = np.unique(self.skin.link_names, return_inverse=True)[1]
        link_index = links[self.skin.patch_index]
        pairs = [np.zeros((0, 2), dtype=np.int64)]
        for link in np.unique(link_index):
            taxels = np.flatnonzero(link_index == link)
            near = KDTree(self.skin.positions[taxels]).query_pairs(
                seam, output_type="ndarray"
            )
            pairs.append(taxels[near.reshape(-1, 2)])
        joined = np.concatenate(pairs)
        patches = self.skin.patch_index[joined]
        return joined[patches[:, 0] != patches[:, 1]]


def find_surfaces(skin: Skin) -> tuple[list[Surface], Int[np.ndarray, "taxel"]]:
    """Find the planes, tubes and domes of a skin; patches may share one."""
    surfaces: list[Surface] = []
    links: list[str] = []
    surface_index = np.full(skin.count, -1)
    for number, patch in enumerate(skin.patches):
        taxels = np.flatnonzero(skin.patch_index == number)
        here = skin.positions[taxels], skin.normals[taxels]
        surface = fit_surface(*here)
        if surface is None:
            continue
        known = (
            i
            for i, other in enumerate(surfaces)
            if links[i] == patch.link and np.max(other.fit_errors(*here)) < TOLERANCE
        )
        index = next(known, len(surfaces))
        if index == len(surfaces):
            surfaces.append(surface)
            links.append(patch.link)
        surface_index[taxels] = index
    return surfaces, surface_index


def surface_distances(
    surface: Surface,
    sources: Float[np.ndarray, "source 3"],
    targets: Float[np.ndarray, "target 3"],
) -> Float[np.ndarray, "source target"]:
    """Return the lengths of the shortest paths on a surface between its points [m].

    They are straight lines on a plane, the shorter helix on a tube, and great circles
    on a dome.
    """
    if isinstance(surface, Dome):
        a, b = (
            local / np.linalg.norm(local, axis=1, keepdims=True)
            for local in (
                surface.to_surface_frame(sources),
                surface.to_surface_frame(targets),
            )
        )
        chord = np.linalg.norm(a[:, None] - b[None], axis=-1)
        return 2 * surface.radius * np.arcsin(np.minimum(chord / 2, 1.0))
    steps = np.abs(surface.unroll(sources)[:, None] - surface.unroll(targets)[None])
    if isinstance(surface, Tube):
        around = 2 * np.pi * surface.radius
        steps[..., 0] = np.minimum(steps[..., 0], around - steps[..., 0])
    return np.linalg.norm(steps, axis=-1)
