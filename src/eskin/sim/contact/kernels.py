"""Compiled kernels that compute contact ellipses and the pressure on taxels."""

import heapq
from typing import NamedTuple, no_type_check

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled


class TaxelGeometry(NamedTuple):
    """This tuple holds the geometry of the taxels that a press may reach."""

    centres: np.ndarray
    """Unrolled centres (taxel, 2) [m]."""
    cells: np.ndarray
    """Half vectors of the sensing part (taxel, 2, 2) [m]."""
    circumference: float
    """Length after which s repeats; infinite unless it is a tube [m]."""
    dome_radius: float
    """Radius of the dome; infinite on other surfaces [m]."""


class ContactEllipses(NamedTuple):
    """This tuple holds the ellipses that the pads of a body press, over time."""

    centres: np.ndarray
    """Unrolled centres (time, pad, 2) [m]."""
    long_axes: np.ndarray
    """Unit vectors of the long axes, unrolled (time, pad, 2)."""
    semi_axes: np.ndarray
    """Semi-axes across and along (time, pad, 2) [m]."""
    peak_pressure: np.ndarray
    """Pressure in the middle (time, pad) [kPa]."""


@compiled
@no_type_check
def compute_loads(
    force: Float[np.ndarray, "time"],
    gaps: Float[np.ndarray, "time part"],
    stiffness: Float[np.ndarray, "part"],
    b: float,
    m: float,
    deepest: float,
    halvings: int,
) -> Float[np.ndarray, "time part"]:
    """Return the load of each pad [N]; all sink by one depth, less their gaps."""
    steps, parts = gaps.shape
    loads = np.zeros((steps, parts))
    for t in range(steps):
        if force[t] <= 0.0:
            continue
        low, high = gaps[t].min(), gaps[t].max() + deepest
        for _ in range(halvings):
            depth = 0.5 * (low + high)
            total = 0.0
            for k in range(parts):
                x = m * min(max(depth - gaps[t, k], 0.0), deepest)
                if x > 0.0:
                    total += stiffness[k] * (np.expm1(x) - x)
            if total * b / m < force[t]:
                low = depth
            else:
                high = depth
        total = 0.0
        for k in range(parts):
            x = m * min(max(high - gaps[t, k], 0.0), deepest)
            loads[t, k] = stiffness[k] * (np.expm1(x) - x)
            total += loads[t, k]
        loads[t] *= force[t] / total
    return loads


@compiled
@no_type_check
def compute_covered_area(
    ellipses: ContactEllipses, min_pressure: float, spots: Float[np.ndarray, "spot 2"]
) -> Float[np.ndarray, "time"]:
    """Return the area [m2] that ellipses cover together above a pressure [kPa].

    A point that lies in n ellipses counts for 1/n in each of them.
    """
    steps, parts = ellipses.peak_pressure.shape
    areas = np.zeros(steps)
    size = np.zeros((parts, 2))
    near = np.empty(parts, dtype=np.int64)
    for t in range(steps):
        for k in range(parts):
            peak = ellipses.peak_pressure[t, k]
            shrunk = np.sqrt(1.0 - min_pressure / peak) if peak > min_pressure else 0.0
            size[k] = shrunk * ellipses.semi_axes[t, k]
        for k in range(parts):
            a, b = size[k]
            if a == 0.0:
                continue
            count = find_overlaps(ellipses.centres[t], size, k, near)
            ls, lt = ellipses.long_axes[t, k]
            mine = 0.0
            for spot in range(len(spots)):
                u, v = a * spots[spot, 0], b * spots[spot, 1]
                s = ellipses.centres[t, k, 0] + u * lt + v * ls
                r = ellipses.centres[t, k, 1] - u * ls + v * lt
                mine += 1.0 / (
                    1 + count_containing(ellipses, size, t, near[:count], s, r)
                )
            areas[t] += np.pi * a * b * mine / len(spots)
    return areas


@compiled
@no_type_check
def find_overlaps(
    centres: Float[np.ndarray, "part 2"],
    size: Float[np.ndarray, "part 2"],
    k: int,
    near: Int[np.ndarray, "part"],
) -> int:
    """Write which ellipses may overlap ellipse k into `near`, and count them."""
    count = 0
    for j in range(len(size)):
        reach = max(size[k, 0], size[k, 1]) + max(size[j, 0], size[j, 1])
        ds = centres[j, 0] - centres[k, 0]
        dr = centres[j, 1] - centres[k, 1]
        if j != k and size[j, 0] > 0.0 and ds * ds + dr * dr < reach * reach:
            near[count] = j
            count += 1
    return count


@compiled
@no_type_check
def count_containing(
    ellipses: ContactEllipses,
    size: Float[np.ndarray, "part 2"],
    t: int,
    near: Int[np.ndarray, "near"],
    s: float,
    r: float,
) -> int:
    """Count the ellipses of `near` that contain the point (s, r)."""
    count = 0
    for j in near:
        ds = s - ellipses.centres[t, j, 0]
        dr = r - ellipses.centres[t, j, 1]
        ls, lt = ellipses.long_axes[t, j]
        u, v = (ds * lt - dr * ls) / size[j, 0], (ds * ls + dr * lt) / size[j, 1]
        if u * u + v * v < 1.0:
            count += 1
    return count


@compiled
@no_type_check
def project_step_on_dome(
    s: float, t: float, ds: float, dt: float, dome: float
) -> tuple[float, float]:
    """Convert a step at the point (s, t) of a dome's polar chart to lengths.

    Lengths toward the pole are true on the chart; those round it are too long.
    """
    away = np.hypot(s, t)
    if away == 0.0:
        return ds, dt
    angle = away / dome
    rs = s / away
    rt = t / away
    radial = ds * rs + dt * rt
    round_it = (dt * rs - ds * rt) * np.sin(angle) / angle
    return radial * rs - round_it * rt, radial * rt + round_it * rs


@compiled
@no_type_check
def compute_taxel_pressure(
    ellipses: ContactEllipses,
    geometry: TaxelGeometry,
    pad_of: Int[np.ndarray, "pair"],
    taxel_of: Int[np.ndarray, "pair"],
    column_of: Int[np.ndarray, "taxel"],
    columns: int,
    nodes: Float[np.ndarray, "size node"],
    weights: Float[np.ndarray, "size node"],
    fine_below: float,
) -> Float[np.ndarray, "time column"]:
    """Return the mean pressure over each taxel's sensing part [kPa], for given pairs.

    Args:
        ellipses: ellipses under load.
        geometry: geometry of the taxels.
        pad_of: pad of each pair.
        taxel_of: taxel of each pair.
        column_of: column of the result for each taxel.
        columns: number of columns.
        nodes: quadrature nodes in -1..1, a row of 2 and one of 3.
        weights: quadrature weights, summing to 1.
        fine_below: share of a cell; the row of 3 is used for smaller semi-axes.
    """
    pressure = np.zeros((len(ellipses.peak_pressure), columns))
    for pair in range(len(pad_of)):
        k = pad_of[pair]
        i = taxel_of[pair]
        column = column_of[i]
        s, t = geometry.centres[i]
        cell = geometry.cells[i]
        reach = np.hypot(
            abs(cell[0, 0]) + abs(cell[1, 0]), abs(cell[0, 1]) + abs(cell[1, 1])
        )
        side = 2.0 * np.sqrt(abs(cell[0, 0] * cell[1, 1] - cell[0, 1] * cell[1, 0]))
        for step in range(len(ellipses.peak_pressure)):
            peak = ellipses.peak_pressure[step, k]
            if peak <= 0.0:
                continue
            a, b = ellipses.semi_axes[step, k]
            ds = s - ellipses.centres[step, k, 0]
            dt = t - ellipses.centres[step, k, 1]
            if geometry.circumference < np.inf:
                ds -= geometry.circumference * np.round(ds / geometry.circumference)
            if ds * ds + dt * dt > (max(a, b) + reach) ** 2:
                continue
            x0 = cell[0, 0]
            y0 = cell[0, 1]
            x1 = cell[1, 0]
            y1 = cell[1, 1]
            if geometry.dome_radius < np.inf:
                mid_s = s - 0.5 * ds
                mid_t = t - 0.5 * dt
                ds, dt = project_step_on_dome(
                    mid_s, mid_t, ds, dt, geometry.dome_radius
                )
                x0, y0 = project_step_on_dome(s, t, x0, y0, geometry.dome_radius)
                x1, y1 = project_step_on_dome(s, t, x1, y1, geometry.dome_radius)
            ls, lt = ellipses.long_axes[step, k]
            u, v = (ds * lt - dt * ls) / a, (ds * ls + dt * lt) / b
            u0 = (x0 * lt - y0 * ls) / a
            v0 = (x0 * ls + y0 * lt) / b
            u1 = (x1 * lt - y1 * ls) / a
            v1 = (x1 * ls + y1 * lt) / b
            fine = 1 if min(a, b) < fine_below * side else 0
            count = 2 + fine
            total = 0.0
            for p in range(count):
                for q in range(count):
                    uu = u + nodes[fine, p] * u0 + nodes[fine, q] * u1
                    vv = v + nodes[fine, p] * v0 + nodes[fine, q] * v1
                    inside = 1.0 - uu * uu - vv * vv
                    if inside > 0.0:
                        total += weights[fine, p] * weights[fine, q] * inside
            pressure[step, column] += peak * total
    return pressure


@compiled
@no_type_check
def compute_movie_pressure(
    movie: Float[np.ndarray, "time row column"],
    pitch: float,
    middle: tuple[float, float],
    centre: Float[np.ndarray, "time 2"],
    angle: Float[np.ndarray, "time"],
    geometry: TaxelGeometry,
) -> Float[np.ndarray, "time taxel"]:
    """Return the pressure of a movie at the centre of each taxel, bilinear [kPa].

    Args:
        movie: pressure at the points of a grid; beyond them it falls to 0 in a pitch.
        pitch: distance of neighbouring points [m].
        middle: row and column that lie on `centre`.
        centre: unrolled place (s, t) of the movie's middle [m].
        angle: angle from the t axis to the movie's y axis [rad].
        geometry: geometry of the taxels.
    """
    steps, rows, columns = movie.shape
    pressure = np.zeros((steps, len(geometry.centres)))
    for step in range(steps):
        cosine = np.cos(angle[step])
        sine = np.sin(angle[step])
        for taxel in range(len(geometry.centres)):
            ds = geometry.centres[taxel, 0] - centre[step, 0]
            dt = geometry.centres[taxel, 1] - centre[step, 1]
            if geometry.circumference < np.inf:
                ds -= geometry.circumference * np.round(ds / geometry.circumference)
            if geometry.dome_radius < np.inf:
                mid_s = centre[step, 0] + 0.5 * ds
                mid_t = centre[step, 1] + 0.5 * dt
                ds, dt = project_step_on_dome(
                    mid_s, mid_t, ds, dt, geometry.dome_radius
                )
            y = middle[0] + (dt * cosine - ds * sine) / pitch
            x = middle[1] + (ds * cosine + dt * sine) / pitch
            row, column = int(np.floor(y)), int(np.floor(x))
            for r in range(max(row, 0), min(row + 2, rows)):
                for c in range(max(column, 0), min(column + 2, columns)):
                    share = (1.0 - abs(y - r)) * (1.0 - abs(x - c))
                    pressure[step, taxel] += share * movie[step, r, c]
    return pressure


@compiled
@no_type_check
def spread_to_neighbours(
    pressure: Float[np.ndarray, "time active"],
    column_of: Int[np.ndarray, "taxel"],
    taxels: Int[np.ndarray, "active"],
    neighbours: Int[np.ndarray, "taxel 4"],
    beta: Float[np.ndarray, "active"],
    columns: int,
) -> Float[np.ndarray, "time column"]:
    """Spread a share of each taxel's pressure to each side; patch edges lose it."""
    spread = np.zeros((len(pressure), columns))
    for active in range(len(taxels)):
        taxel = taxels[active]
        share_out = beta[active]
        own = column_of[taxel]
        for t in range(len(pressure)):
            spread[t, own] += (1.0 - 4.0 * share_out) * pressure[t, active]
        for side in range(4):
            other = neighbours[taxel, side]
            if other >= 0:
                column = column_of[other]
                for t in range(len(pressure)):
                    spread[t, column] += share_out * pressure[t, active]
    return spread


@compiled
@no_type_check
def turn_vector(
    vector: Float[np.ndarray, "3"],
    start: Float[np.ndarray, "3"],
    end: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "3"]:
    """Turn a vector by the shortest rotation from one unit vector to another."""
    cross = np.cross(start, end)
    cosine = dot(start, end)
    if cosine < -0.999999:
        return vector.copy()
    along = dot(cross, vector) / (1.0 + cosine)
    return cosine * vector + np.cross(cross, vector) + along * cross


@compiled
@no_type_check
def dot(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> float:
    """Return the dot product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@compiled
@no_type_check
def unroll_step(
    positions: Float[np.ndarray, "taxel 3"],
    normals: Float[np.ndarray, "taxel 3"],
    axes: Float[np.ndarray, "taxel 2 3"],
    i: int,
    j: int,
) -> tuple[float, float]:
    """Return the step from taxel i to taxel j, along the axes of taxel i [m].

    Between two points of a circle it is the arc.
    """
    middle = normals[i] + normals[j]
    size = np.sqrt(dot(middle, middle))
    step = positions[j] - positions[i]
    middle /= max(size, 1e-12)
    first = turn_vector(axes[i, 0], normals[i], middle)
    second = np.cross(middle, first)
    s = dot(first, step)
    t = dot(second, step)
    flat = np.sqrt(s * s + t * t)
    if flat < 1e-12:
        return 0.0, 0.0
    half = 0.5 * np.arccos(min(max(dot(normals[i], normals[j]), -1.0), 1.0))
    arc = np.sqrt(dot(step, step)) * (half / np.sin(half) if half > 1e-6 else 1.0)
    return s * arc / flat, t * arc / flat


@compiled
@no_type_check
def unroll_mesh(
    positions: Float[np.ndarray, "taxel 3"],
    normals: Float[np.ndarray, "taxel 3"],
    starts: Int[np.ndarray, "taxel_and_one"],
    joined: Int[np.ndarray, "entry"],
    centre: int,
    start_axes: Float[np.ndarray, "2 3"],
    reach: float,
) -> tuple[
    Bool[np.ndarray, "taxel"],
    Float[np.ndarray, "taxel 2"],
    Float[np.ndarray, "taxel 2 3"],
]:
    """Unroll the taxels around one, in the order of their distances (Schmidt 2006).

    A taxel is placed from those before it that agree with its nearest one on where it
    lies, so that places on both sides of a limb are not averaged.

    Args:
        positions: centres of the taxels [m].
        normals: unit normals of the taxels.
        starts: first entry of each taxel in `joined`.
        joined: taxels that each taxel is joined to.
        centre: taxel that becomes (0, 0).
        start_axes: unit directions of s and t there.
        reach: distance up to which taxels are unrolled [m].

    Returns:
        Which taxels were reached, their places (s, t) [m], and the directions of s and
        t at each of them.
    """
    count = len(positions)
    done = np.zeros(count, dtype=np.bool_)
    flat = np.zeros((count, 2))
    axes = np.zeros((count, 2, 3))
    best = np.full(count, np.inf)
    parent = np.full(count, -1)
    best[centre] = 0.0
    waiting = [(0.0, centre)]
    while len(waiting) > 0:
        length, j = heapq.heappop(waiting)
        if done[j] or length > best[j]:
            continue
        if j == centre:
            axes[j] = start_axes
        else:
            s, t = unroll_step(positions, normals, axes, parent[j], j)
            s = s + flat[parent[j], 0]
            t = t + flat[parent[j], 1]
            near = 0.3 * (length - best[parent[j]])
            total = 0.0
            mean_s = 0.0
            mean_t = 0.0
            first = np.zeros(3)
            for entry in range(starts[j], starts[j + 1]):
                i = joined[entry]
                if not done[i]:
                    continue
                ds, dt = unroll_step(positions, normals, axes, i, j)
                size = np.sqrt(ds * ds + dt * dt)
                ds = ds + flat[i, 0]
                dt = dt + flat[i, 1]
                if np.hypot(ds - s, dt - t) > near and i != parent[j]:
                    continue
                weight = 1.0 / max(size, 1e-9)
                total += weight
                mean_s += weight * ds
                mean_t += weight * dt
                first += weight * turn_vector(axes[i, 0], normals[i], normals[j])
            flat[j, 0] = mean_s / total
            flat[j, 1] = mean_t / total
            first -= dot(first, normals[j]) * normals[j]
            axes[j, 0] = first / max(np.sqrt(dot(first, first)), 1e-12)
            axes[j, 1] = np.cross(normals[j], axes[j, 0])
        done[j] = True
        for entry in range(starts[j], starts[j + 1]):
            i = joined[entry]
            if done[i]:
                continue
            ds, dt = unroll_step(positions, normals, axes, j, i)
            onward = length + np.sqrt(ds * ds + dt * dt)
            if onward < best[i] and onward <= reach:
                best[i] = onward
                parent[i] = j
                heapq.heappush(waiting, (onward, i))
    return done, flat, axes
