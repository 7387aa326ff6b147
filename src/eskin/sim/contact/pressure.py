"""This module computes the pressure on taxels from a press, or from a recorded movie.

The pads of a body share its load as springs that sink together, each makes an ellipse
of a size that depends on its load, and the pressure in it is an inverted paraboloid
(Pawluk and Howe 1999). The film over the taxels spreads pressure to neighbours.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.constants import MM, Constants
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.kernels import (
    ContactEllipses,
    TaxelGeometry,
    compute_covered_area,
    compute_loads,
    compute_movie_pressure,
    compute_taxel_pressure,
    spread_to_neighbours,
)
from eskin.sim.contact.press import ContactPads, MoviePress, Press, SoftTissue
from eskin.sim.contact.sheet import Sheet
from eskin.skin import Dome, Skin, Tube

KPA_PER_PA = 1e-3

Lengths = Float[np.ndarray, "time part"]
Points = Float[np.ndarray, "time part 2"]


def compute_contact_ellipses(
    press: Press, chart: Chart, constants: Constants
) -> tuple[ContactEllipses, Float[np.ndarray, "time"], Float[np.ndarray, "time 2"]]:
    """Return the ellipses of a press, its contact area [m2] and its centroid [m]."""
    offsets = compute_pad_offsets(press)
    turned = press.angle[:, None] + press.pads.angles
    long = np.stack([-np.sin(turned), np.cos(turned)], axis=2)
    centres = press.centre[:, None]
    if isinstance(chart.surface, Dome):
        centres = centres + stretch_steps_on_dome(centres, offsets, chart.radius)
    else:
        centres = centres + offsets
    curvatures = compute_relative_curvatures(press.pads, chart, long, centres)
    off = compute_pad_gaps(press.tissue, chart, offsets, press.centre)
    off[chart.is_beyond(centres)] = constants.value("contact.off")
    loads = compute_loads(
        press.force,
        off,
        press.pads.stiffness,
        press.tissue.b,
        press.tissue.m,
        constants.value("contact.deepest") * MM,
        int(constants.value("contact.halvings")),
    )
    areas = compute_contact_areas(press, curvatures, loads, constants)
    ratio = np.sqrt(curvatures[..., 0] / curvatures[..., 1])
    across = np.sqrt(areas / np.pi / ratio)
    axes = np.stack([across, across * ratio], axis=2)
    safe = np.where(areas > 0.0, areas, 1.0)
    peak = 2.0 * loads / safe * KPA_PER_PA
    ellipses = ContactEllipses(centres, long, axes, peak)
    area = compute_covered_area(
        ellipses, constants.value("contact.touched"), DISC_POINTS
    )
    return ellipses, area, compute_centroid(press, centres, loads)


def compute_pad_offsets(press: Press) -> Points:
    """Return the pads' offsets from the centre, as arc lengths (s, t) [m]."""
    from_middle = press.pads.centres - press.pads.centres.mean(axis=0)
    cos = np.cos(press.angle)[:, None]
    sin = np.sin(press.angle)[:, None]
    x, y = from_middle.T
    return np.stack([x * cos - y * sin, x * sin + y * cos], axis=2)


LEAST_CURVED = 0.2
"""Least curvature of a pad against a hollow surface, over its own."""


def compute_relative_curvatures(
    pads: ContactPads, chart: Chart, long: Points, centres: Points
) -> Points:
    """Return each pad's curvature against the surface, across and along it [1/m].

    `long` holds unit vectors of the pads' long axes and `centres` their centres [m],
    both as (s, t).
    """
    own = np.broadcast_to(1.0 / pads.radii, long.shape)
    if isinstance(chart.surface, Sheet):
        bent = chart.surface.compute_curvature(centres)
        across = np.stack([long[..., 1], -long[..., 0]], axis=-1)
        both = np.stack([across, long], axis=-2)
        added = np.einsum("...wi,...ij,...wj->...w", both, bent, both)
        return np.maximum(own + added, LEAST_CURVED * own)
    if isinstance(chart.surface, Tube):
        # The long axis follows the tube's curvature by its share of s.
        return own + long[..., ::-1] ** 2 / chart.radius
    if isinstance(chart.surface, Dome):
        return own + 1.0 / chart.radius
    return own


def compute_pad_gaps(
    tissue: SoftTissue,
    chart: Chart,
    offsets: Points,
    centre: Float[np.ndarray, "time 2"],
) -> Lengths:
    """Return how far pads stay off a round surface that the body wraps poorly [m].

    `offsets` of the pads are from the centre of the body, both unrolled (s, t) [m].
    """
    if isinstance(chart.surface, Sheet):
        bent = chart.surface.compute_curvature(centre)
        drop = np.einsum("tki,tij,tkj->tk", offsets, bent, offsets) / 2
        return (1.0 - tissue.conformity) * np.maximum(drop, 0.0)
    round_way = np.zeros(offsets.shape[:2])
    if isinstance(chart.surface, Tube | Dome):
        round_way = offsets[..., 0] ** 2
    if isinstance(chart.surface, Dome):
        round_way = round_way + offsets[..., 1] ** 2
    return (1.0 - tissue.conformity) * round_way / (2.0 * chart.radius)


def compute_contact_areas(
    press: Press, curvatures: Points, loads: Lengths, constants: Constants
) -> Lengths:
    """Return the area of each ellipse [m2], a power of its load.

    It is smaller on a rounder surface.
    """
    pads = press.pads
    tissue = press.tissue
    grown = tissue.area_scale * pads.area * loads**tissue.area_exponent
    flat = np.prod(1.0 / pads.radii, axis=1)
    rounder = np.sqrt(flat / np.prod(curvatures, axis=2))
    exponent = constants.value("contact.curvature_exponent")
    return np.minimum(pads.max_area, grown) * rounder**exponent


DOME_ITERATIONS = 4


def stretch_steps_on_dome(start: np.ndarray, offsets: Points, radius: float) -> Points:
    """Convert offsets in tangent planes of a dome to steps on its polar chart [m].

    The chart is taken at the middle of each step, which is found by iteration.
    """
    steps = offsets
    for _ in range(DOME_ITERATIONS):
        middle = start + steps / 2
        away = np.linalg.norm(middle, axis=2, keepdims=True)
        outward = middle / np.where(away > 0.0, away, 1.0)
        radial = np.sum(offsets * outward, axis=2, keepdims=True) * outward
        steps = radial + (offsets - radial) / np.sinc(away / radius / np.pi)
    return steps


def build_disc_points(count: int) -> Float[np.ndarray, "spot 2"]:
    """Build points that fill the unit disc evenly, ordered as a sunflower's seeds."""
    index = np.arange(count)
    turn = index * np.pi * (3.0 - np.sqrt(5.0))
    away = np.sqrt((index + 0.5) / count)
    return np.column_stack([away * np.cos(turn), away * np.sin(turn)])


DISC_POINTS = build_disc_points(16)


def compute_centroid(
    press: Press, centres: Points, loads: Lengths
) -> Float[np.ndarray, "time 2"]:
    """Return where the force acts, unrolled (s, t) [m].

    Without force it is the press's centre.
    """
    total = loads.sum(axis=1)
    moment = np.einsum("tk,tkd->td", loads, centres)
    mean = moment / np.where(total > 0.0, total, 1.0)[:, None]
    return np.where(total[:, None] > 0.0, mean, press.centre)


def compute_leak_share(
    sigma: float, areas: Float[np.ndarray, "taxel"]
) -> Float[np.ndarray, "taxel"]:
    """Return the share of its load that an evenly loaded taxel gives to each side.

    Args:
        sigma: standard deviation of the film's Gaussian spread [m].
        areas: areas of the taxels, taken as square [m2].
    """
    return sigma / np.sqrt(2 * np.pi * areas)


@lru_cache(maxsize=4)
def find_grid_neighbours(skin: Skin) -> Int[np.ndarray, "taxel 4"]:
    """Find the taxels beside each one in its patch's grid, -1 for none; cached.

    Columns of the result: the column before, the column after, the row before, the row
    after.
    """
    rows, columns = skin.rows + 1, skin.columns + 1
    shape = (len(skin.patches), rows.max(initial=0) + 2, columns.max(initial=0) + 2)
    grid = np.full(shape, -1, dtype=np.int64)
    grid[skin.patch_index, rows, columns] = np.arange(skin.count)
    sides = ((0, -1), (0, 1), (-1, 0), (1, 0))
    found = [grid[skin.patch_index, rows + r, columns + c] for r, c in sides]
    return np.stack(found, axis=1)


def spread_through_film(
    pressure: Float[np.ndarray, "time active"],
    taxels: Int[np.ndarray, "active"],
    neighbours: Int[np.ndarray, "taxel 4"],
    beta: float | Float[np.ndarray, "taxel"],
) -> tuple[Float[np.ndarray, "time more"], Int[np.ndarray, "more"]]:
    """Return pressures after the film [kPa], and their taxels, ascending.

    Args:
        pressure: pressure of the active taxels [kPa].
        taxels: active taxels, as indices of the skin.
        neighbours: result of `find_grid_neighbours`.
        beta: share given to each side, one for all taxels of the skin or one each; the
            edge of a patch loses it.
    """
    reached = np.unique(np.append(neighbours[taxels], taxels))
    reached = reached[reached >= 0]
    column_of = np.zeros(len(neighbours), dtype=np.int64)
    column_of[reached] = np.arange(len(reached))
    shares = np.broadcast_to(np.asarray(beta, dtype=float), len(neighbours))[taxels]
    return spread_to_neighbours(
        pressure, column_of, taxels, neighbours, shares, len(reached)
    ), reached


@dataclass(frozen=True, eq=False)
class PressureField:
    """A pressure field holds what one press does to the skin through time."""

    taxels: Int[np.ndarray, "active"]
    """Indices into the skin's taxels, ascending, of all that are ever pressed."""
    pressure: Float[np.ndarray, "time active"]
    """Mean pressure over the sensing part of each taxel [kPa]."""
    area: Float[np.ndarray, "time"]
    """True area of contact, on taxels or beside them [m2]."""
    force: Float[np.ndarray, "time"]
    """True force on the surface, on taxels or beside them [N]."""
    centroid: Float[np.ndarray, "time 2"]
    """Point where the force acts, unrolled (s, t); s goes on past a turn of a tube [m].
    """


def compute_pressure_field(
    press: Press, chart: Chart, constants: Constants
) -> PressureField:
    """Compute the pressure of a press on a chart's taxels, and its true contact."""
    ellipses, area, centroid = compute_contact_ellipses(press, chart, constants)
    geometry = build_taxel_geometry(chart, constants)
    pairs = np.nonzero(find_reachable_pairs(ellipses, geometry))
    # Of several pairs numpy returns strided views, for which code is compiled anew.
    pad_of, taxel_of = map(np.ascontiguousarray, pairs)
    reached = np.unique(taxel_of)
    column_of = np.zeros(len(chart.taxels), dtype=np.int64)
    column_of[reached] = np.arange(len(reached))
    pressure = compute_taxel_pressure(
        ellipses,
        geometry,
        pad_of,
        taxel_of,
        column_of,
        len(reached),
        NODES,
        WEIGHTS,
        constants.value("contact.fine_below"),
    )
    pressed = pressure.max(axis=0, initial=0.0) > 0.0
    return PressureField(
        taxels=chart.taxels[reached[pressed]],
        pressure=pressure[:, pressed],
        area=area,
        force=np.maximum(press.force, 0.0),
        centroid=centroid,
    )


def build_taxel_geometry(chart: Chart, constants: Constants) -> TaxelGeometry:
    """Build the geometry of a chart's taxels, of which only the middle part senses."""
    cells = chart.cells * np.sqrt(constants.value("contact.fill"))
    dome = chart.radius if isinstance(chart.surface, Dome) else np.inf
    centres = np.ascontiguousarray(chart.unrolled)
    return TaxelGeometry(centres, cells, chart.circumference, dome)


def find_reachable_pairs(
    ellipses: ContactEllipses, geometry: TaxelGeometry
) -> Bool[np.ndarray, "part taxel"]:
    """Tell which pads may ever meet which taxels, by boxes around their paths."""
    loaded = ellipses.peak_pressure > 0.0
    used = np.any(loaded, axis=0)
    centres = ellipses.centres
    inside = loaded[..., None]
    low = np.where(inside, centres, np.inf).min(axis=0, initial=FAR_DISTANCE)
    high = np.where(inside, centres, -np.inf).max(axis=0, initial=-FAR_DISTANCE)
    size = np.where(loaded, ellipses.semi_axes.max(axis=2), 0.0)
    size = size.max(axis=0, initial=0.0)
    half = (high - low) / 2 + size[:, None]
    half = half + np.abs(geometry.cells).sum(axis=1).max(axis=0, initial=0.0)
    if np.isfinite(geometry.dome_radius):
        half = half * MAX_DOME_STRETCH
    away = geometry.centres - (low + high)[:, None] / 2
    if np.isfinite(geometry.circumference):
        turn = geometry.circumference
        away[..., 0] -= turn * np.round(away[..., 0] / turn)
    return used[:, None] & np.all(np.abs(away) <= half[:, None], axis=2)


FAR_DISTANCE = 1e6
"""Distance beyond anything of a robot [m]."""

MAX_DOME_STRETCH = np.pi / 2
"""Largest factor by which a dome's chart stretches lengths: at its rim, a quarter turn
from the pole."""


def build_quadrature() -> tuple[Float[np.ndarray, "2 3"], Float[np.ndarray, "2 3"]]:
    """Build Gauss nodes and weights, two points in the first row, three in the other.

    The weights sum to 1.
    """
    nodes = np.zeros((2, 3))
    weights = np.zeros((2, 3))
    for row, count in enumerate((2, 3)):
        nodes[row, :count], weights[row, :count] = np.polynomial.legendre.leggauss(
            count
        )
    return nodes, weights / 2


NODES, WEIGHTS = build_quadrature()


N_PER_KPA_M2 = 1e3
"""Force of 1 kPa on 1 m2 [N]."""


def compute_movie_field(
    press: MoviePress, chart: Chart, constants: Constants
) -> PressureField:
    """Compute the pressure of a movie on a chart's taxels, and its true contact."""
    pressure = compute_movie_pressure(
        press.pressure,
        press.pitch,
        press.middle,
        press.centre,
        press.angle,
        build_taxel_geometry(chart, constants),
    )
    pressed = pressure.max(axis=0, initial=0.0) > 0.0
    touched = press.pressure >= constants.value("contact.touched")
    cells = np.where(press.force > 0.0, touched.sum(axis=(1, 2)), 0)
    return PressureField(
        taxels=chart.taxels[pressed],
        pressure=pressure[:, pressed],
        area=cells * press.pitch**2,
        force=press.force,
        centroid=compute_movie_centroid(press, chart),
    )


def compute_movie_force(
    pressure: Float[np.ndarray, "time row column"], pitch: float
) -> Float[np.ndarray, "time"]:
    """Return the force of a movie at each step [N]."""
    return pressure.sum(axis=(1, 2)) * pitch**2 * N_PER_KPA_M2


def find_middle(
    pressure: Float[np.ndarray, "*time row column"],
) -> Float[np.ndarray, "*time 2"]:
    """Find row and column of the centre of pressure; NaN without pressure."""
    rows, columns = np.arange(pressure.shape[-2]), np.arange(pressure.shape[-1])
    with np.errstate(invalid="ignore"):
        by_row = pressure.sum(axis=-1) / pressure.sum(axis=(-2, -1))[..., None]
        by_column = pressure.sum(axis=-2) / pressure.sum(axis=(-2, -1))[..., None]
    return np.stack([by_row @ rows, by_column @ columns], axis=-1)


def compute_movie_centroid(
    press: MoviePress, chart: Chart
) -> Float[np.ndarray, "time 2"]:
    """Return where the force acts, unrolled (s, t); the centre without force [m]."""
    from_middle = np.nan_to_num(find_middle(press.pressure) - press.middle)
    y, x = press.pitch * from_middle.T
    cos = np.cos(press.angle)
    sin = np.sin(press.angle)
    offsets = np.column_stack([x * cos - y * sin, x * sin + y * cos])
    if isinstance(chart.surface, Dome):
        start = press.centre[:, None]
        offsets = stretch_steps_on_dome(start, offsets[:, None], chart.radius)[:, 0]
    return press.centre + offsets
