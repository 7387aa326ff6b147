"""Build skins for textbook touches, and compute the pressures of an ideal sensor."""

from dataclasses import dataclass
from functools import lru_cache
from math import ceil, floor, inf, pi
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from eskin.robot import load_robot
from eskin.skin import (
    MountedSkin,
    Patch,
    Plane,
    Skin,
    Surface,
    TaxelGrid,
    Tube,
    build_skin,
    load_skin,
)
from eskin.skin.presets import UR5_PARTS
from eskin.touch import Calibration
from lab.textbook.touches import Spot, TextbookTouch, path_ends

SurfaceName = Literal["flat", "round", "ur5"]

WIDTH, LENGTH = 0.16, 0.24
"""Size of the flat patch; also the length of the tube [m]."""
RADIUS = 0.0375
"""Radius of the tube, as of a UR5's forearm [m]."""
LATTICE = 0.001
"""Greatest distance of the points at which the pressure on a taxel is sampled [m]."""
EDGE = 0.008
"""Distance from the edge of a skin within which nothing is touched [m]."""

GAIN = 0.02
"""Pressure of one count [kPa]."""
FULL_SCALE = 65_000
"""Counts at full scale, 1300 kPa, which no touch here reaches."""
REST = 500
"""Counts at rest."""
NOISE = 0.1
"""Standard deviation of the white noise [kPa]: 0.1 % of a sensor for 100 kPa."""


@dataclass(frozen=True, eq=False)
class Site:
    """Describes an unrolled part of a skin that can be touched."""

    mounted: MountedSkin
    girth: float
    """Circumference, the period of s; infinite on a flat site [m]."""
    half: tuple[float, float]
    """Half of the extents along s and t within which touches lie [m]."""
    points: Float[np.ndarray, "point 2"]
    """Points at which pressure is evaluated, taxel by taxel [m]."""
    taxel: Int[np.ndarray, "point"]
    """Taxel of each point."""
    per_taxel: int
    """Number of points per taxel."""
    q: Float[np.ndarray, "joint"]
    """Joint positions of the robot [rad]."""

    @property
    def calibration(self) -> Calibration:
        """Calibration of a linear sensor."""
        return Calibration(np.full(self.mounted.skin.count, GAIN), FULL_SCALE)

    def holds(self, spots: tuple[Spot, ...], travel: tuple[float, float]) -> bool:
        """Return whether spots lie inside before and after their travel [m]."""
        return all(
            abs(s) + reach <= self.half[0] and abs(t) + reach <= self.half[1]
            for s, t, reach in path_ends(spots, travel)
        )

    def pressure(
        self, touch: TextbookTouch, times: Float[np.ndarray, "step"]
    ) -> Float[np.ndarray, "step taxel"]:
        """Return the mean pressure on each taxel at each time [kPa]."""
        share = touch.share(times)
        shift = touch.shift(times) if touch.moves else np.zeros((1, 2))
        field = np.zeros((len(shift), self.mounted.skin.count))
        for spot in touch.spots:
            self.add_pressure(spot, shift, field)
        return share[:, None] * field

    def add_pressure(
        self,
        spot: Spot,
        shift: Float[np.ndarray, "step 2"],
        field: Float[np.ndarray, "step taxel"],
    ) -> None:
        """Add the pressure of a spot at every step of its path [kPa]."""
        apart = self.points - spot.centre
        if self.girth < inf:
            half = self.girth / 2
            middle = shift[-1, 0] / 2
            apart[:, 0] = (apart[:, 0] - middle + half) % self.girth - half + middle
        near = np.flatnonzero(compute_path_distance(apart, shift[-1]) <= spot.reach)
        if not len(near):
            return
        c, d = np.cos(spot.angle), np.sin(spot.angle)
        local = (apart[near] - shift[:, None]) @ np.array([[c, -d], [d, c]])
        part = np.maximum(1.0 - np.sum((local / spot.axes) ** 2, axis=2), 0.0)
        taxels, firsts = np.unique(self.taxel[near], return_index=True)
        total = np.add.reduceat(part, firsts, axis=1)
        field[:, taxels] += spot.peak / self.per_taxel * total


def compute_path_distance(
    apart: Float[np.ndarray, "point 2"], way: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "point"]:
    """Return the distances of points from the line from the origin to `way` [m]."""
    along = apart @ way / max(way @ way, 1e-12)
    return np.linalg.norm(apart - np.clip(along, 0.0, 1.0)[:, None] * way, axis=1)


@lru_cache(maxsize=32)
def build_site(surface: SurfaceName, pitch: float) -> Site:
    """Build a site to touch.

    Args:
        surface: a flat patch, a tube, or the forearm of the ur5 skin.
        pitch: distance of neighbouring taxels; unused for `ur5` [m].
    """
    if surface == "flat":
        return build_flat_site(pitch)
    return build_round_site(pitch) if surface == "round" else build_ur5_site()


def build_flat_site(pitch: float) -> Site:
    """Build a flat patch of 16 x 24 cm on a table."""
    rows, columns = round(LENGTH / pitch), round(WIDTH / pitch)
    plane = Plane(np.eye(4))
    patch = Patch("flat", "table", 1, rows, columns)
    skin = build_skin("flat", [(patch, TaxelGrid(rows, columns, pitch, pitch), plane)])
    every = np.arange(skin.count)
    half = columns * pitch / 2 - EDGE, rows * pitch / 2 - EDGE
    mounted = MountedSkin(skin, load_robot("table"))
    return place_evaluation_points(mounted, plane, every, pitch, inf, half)


def build_round_site(pitch: float) -> Site:
    """Build a tube of 24 cm under two half shells, with a pitch that fits."""
    columns = max(1, floor(pi * RADIUS / pitch + 0.5))
    pitch = pi * RADIUS / columns
    rows = round(LENGTH / pitch)
    grid = TaxelGrid(rows, columns, pitch, pitch)
    tubes = [Tube(RADIUS, np.diag([x, x, 1.0, 1.0])) for x in (1.0, -1.0)]
    skin = build_skin(
        "round",
        [
            (Patch(name, "tube", number, rows, columns), grid, tube)
            for number, (name, tube) in enumerate(
                zip(("front", "back"), tubes, strict=True), 1
            )
        ],
    )
    mounted = MountedSkin(skin, load_robot("tube"))
    half = inf, rows * pitch / 2 - EDGE
    return place_evaluation_points(
        mounted, tubes[0], np.arange(skin.count), pitch, 2 * pi * RADIUS, half
    )


def build_ur5_site() -> Site:
    """Build the forearm of the ur5 skin: two patches and the bare strips between."""
    skin, part = load_skin("ur5"), UR5_PARTS["forearm"]
    shells = [skin.find_taxels(f"forearm_{side}") for side in ("front", "back")]
    rows = max(p.rows for p in skin.patches if p.id == "forearm_front")
    taxels = np.concatenate(shells)
    tube = part.surface((1.0, 0.0, 0.0), 0.0)
    heights = np.unique(np.round(tube.unroll(skin.positions[taxels])[:, 1], 9))
    pitch = float(np.ptp(heights) / (rows - 1))
    mounted = MountedSkin(skin, load_robot("ur5"))
    half = inf, rows * pitch / 2 - EDGE
    return place_evaluation_points(mounted, tube, taxels, pitch, part.width, half)


def place_evaluation_points(
    mounted: MountedSkin,
    surface: Surface,
    taxels: Int[np.ndarray, "touched"],
    row_pitch: float,
    girth: float,
    half: tuple[float, float],
) -> Site:
    """Build a site with the points at which its taxels are evaluated.

    Args:
        mounted: skin on its robot.
        surface: surface of the taxels.
        taxels: taxels that can be touched.
        row_pitch: distance of their rows; the width of a cell follows from its area
        [m].
        girth: circumference of the surface [m].
        half: half of the extents of the part that can be touched [m].
    """
    skin: Skin = mounted.skin
    centres = surface.unroll(skin.positions[taxels])
    widths = skin.areas[taxels] / row_pitch
    fine = ceil(max(widths.max(), row_pitch) / LATTICE)
    steps = (np.arange(fine) + 0.5) / fine - 0.5
    inner = np.stack(np.meshgrid(steps, steps), axis=2).reshape(-1, 2)
    sides = np.column_stack([widths, np.full(len(taxels), row_pitch)])
    points = centres[:, None] + inner * sides[:, None]
    return Site(
        mounted=mounted,
        girth=girth,
        half=half,
        points=points.reshape(-1, 2),
        taxel=np.repeat(taxels, len(inner)),
        per_taxel=len(inner),
        q=np.full(len(mounted.robot.joint_names), -0.5),
    )
