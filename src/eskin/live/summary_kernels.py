"""The compiled summary: `pressure_summary` and `shear_summary` of one graph.

Sums are taken in float64, one node after the other.
"""

import math
from typing import no_type_check

import numpy as np
from jaxtyping import Float

from eskin.graph.features import (
    AREA,
    FLAT,
    FORCE,
    HISTORY_FLOORS,
    LEVELS,
    N_PER_KPA_CM2,
    NEAR,
    PRESSURE,
    RATE,
    SPEED,
)
from eskin.live.graph import Graph
from eskin.live.kernels import compiled_network

Vector = tuple[float, float, float]

LEAST = 1e-6
"""Weight below which a load has no centre [kPa cm2]."""
ROTATIONS = 5
"""Sweeps of Jacobi's method; four bring 3x3 matrices to float64's last digit."""


@compiled_network
@no_type_check
def summarise(
    graph: Graph,
    shear: bool,
    out: Float[np.ndarray, "feature"],
) -> None:
    """Write the summary of a graph: what `PRESSURE_SUMMARY`, then `SHEAR_SUMMARY` name.

    Args:
        graph: the graph.
        shear: whether the network takes shear; else it is left out.
        out: where the summary goes.
    """
    force, centre, velocity = motion_of(graph)
    at = summarise_pressure(graph, force, centre, velocity, out)
    for k in range(len(HISTORY_FLOORS)):
        out[at + k] = log(graph.history[k], HISTORY_FLOORS[k])
    if shear:
        at += len(HISTORY_FLOORS)
        summarise_shear(graph, force, centre, velocity, out[at:])


@compiled_network
@no_type_check
def motion_of(graph: Graph) -> tuple[float, Vector, Vector]:
    """The load's force [N], its centre [cm] and how that moves [cm/s]."""
    now, before = 0.0, 0.0
    x, y, z, x_before, y_before, z_before = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(graph.nodes):
        p, p_before = graph.pressure[i], graph.before[i]
        if p == 0.0 and p_before == 0.0:
            continue
        weight = np.float64(p) * graph.areas[i]
        weight_before = np.float64(p_before) * graph.areas[i]
        now += weight
        before += weight_before
        x += weight * graph.positions[i, 0]
        y += weight * graph.positions[i, 1]
        z += weight * graph.positions[i, 2]
        x_before += weight_before * graph.positions[i, 0]
        y_before += weight_before * graph.positions[i, 1]
        z_before += weight_before * graph.positions[i, 2]
    heavy, heavy_before = max(now, LEAST), max(before, LEAST)
    centre = (x / heavy, y / heavy, z / heavy)
    velocity = (0.0, 0.0, 0.0)
    if now > 0.0 and before > 0.0:
        velocity = (
            (centre[0] - x_before / heavy_before) / graph.seconds,
            (centre[1] - y_before / heavy_before) / graph.seconds,
            (centre[2] - z_before / heavy_before) / graph.seconds,
        )
    return now * N_PER_KPA_CM2, centre, velocity


@compiled_network
@no_type_check
def summarise_pressure(
    graph: Graph,
    force: float,
    centre: Vector,
    velocity: Vector,
    out: Float[np.ndarray, "feature"],
) -> int:
    """Write what the pressure tells, and return how many columns that takes."""
    peak, area, squares, loading, unloading = 0.0, 0.0, 0.0, 0.0, 0.0
    low, middle, high = 0.0, 0.0, 0.0
    nx, ny, nz = 0.0, 0.0, 0.0
    xx, yy, zz, xy, xz, yz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(graph.nodes):
        p, a = np.float64(graph.pressure[i]), np.float64(graph.areas[i])
        change = (p - graph.before[i]) * a * N_PER_KPA_CM2
        loading += max(change, 0.0)
        unloading += max(-change, 0.0)
        if p == 0.0:
            continue
        peak = max(peak, p)
        area += a
        low += a if p > LEVELS[0] else 0.0
        middle += a if p > LEVELS[1] else 0.0
        high += a if p > LEVELS[2] else 0.0
        weight = p * a
        squares += p * weight
        nx += weight * graph.normals[i, 0]
        ny += weight * graph.normals[i, 1]
        nz += weight * graph.normals[i, 2]
        x = graph.positions[i, 0] - centre[0]
        y = graph.positions[i, 1] - centre[1]
        z = graph.positions[i, 2] - centre[2]
        xx, yy, zz = xx + weight * x * x, yy + weight * y * y, zz + weight * z * z
        xy, xz, yz = xy + weight * x * y, xz + weight * x * z, yz + weight * y * z
    total = force / N_PER_KPA_CM2
    heavy = max(total, LEAST)
    spreads = eigenvalues(
        xx / heavy, yy / heavy, zz / heavy, xy / heavy, xz / heavy, yz / heavy
    )
    loading, unloading = loading / graph.seconds, unloading / graph.seconds
    mean, square = total / (area + AREA), squares / (area + AREA)
    length, breadth = extent(spreads[0]), extent(spreads[1])
    speed = length_of(velocity[0], velocity[1], velocity[2])
    pressed = square * area * N_PER_KPA_CM2**2
    columns = (
        log(force, FORCE),
        log(peak, PRESSURE),
        log(area, AREA),
        log(low, AREA),
        log(middle, AREA),
        log(high, AREA),
        length,
        breadth,
        extent(spreads[2]),
        breadth / (length + 0.1),
        length_of(nx, ny, nz) / heavy,
        log(loading, RATE),
        log(unloading, RATE),
        log(loading + unloading, RATE) - log(force, FORCE),
        log(speed, SPEED),
        mean / 50.0,
        math.sqrt(max(square - mean * mean, 0.0)) / 50.0,
        log(pressed, FORCE * 0.1) - 2.0 * log(force, FORCE),
        log(area, AREA) - log(high, AREA),
    )
    for k in range(len(columns)):
        out[k] = columns[k]
    return len(columns)


@compiled_network
@no_type_check
def summarise_shear(
    graph: Graph,
    force: float,
    centre: Vector,
    velocity: Vector,
    out: Float[np.ndarray, "feature"],
) -> None:
    """Write what the shear tells."""
    size, peak, rate, divergence = 0.0, 0.0, 0.0, 0.0
    nx, ny, nz, bx, by, bz, cx, cy, cz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(graph.nodes):
        a = np.float64(graph.areas[i]) * N_PER_KPA_CM2
        s, earlier = graph.shear[i], graph.shear_before[i]
        peak = max(peak, length_of(s[0], s[1], s[2]))
        sx, sy, sz = s[0] * a, s[1] * a, s[2] * a
        ex, ey, ez = earlier[0] * a, earlier[1] * a, earlier[2] * a
        size += length_of(sx, sy, sz)
        rate += length_of(sx - ex, sy - ey, sz - ez) / graph.seconds
        nx, ny, nz = nx + sx, ny + sy, nz + sz
        bx, by, bz = bx + ex, by + ey, bz + ez
        x = graph.positions[i, 0] - centre[0]
        y = graph.positions[i, 1] - centre[1]
        z = graph.positions[i, 2] - centre[2]
        outward = 1.0 / (length_of(x, y, z) + NEAR)
        divergence += (sx * x + sy * y + sz * z) * outward
        cx += (y * sz - z * sy) * outward
        cy += (z * sx - x * sz) * outward
        cz += (x * sy - y * sx) * outward
    scale = size + FORCE
    net, net_before = length_of(nx, ny, nz), length_of(bx, by, bz)
    net_rate = length_of(nx - bx, ny - by, nz - bz) / graph.seconds
    vx, vy, vz = velocity[0], velocity[1], velocity[2]
    along = nx * vx + ny * vy + nz * vz
    turned = nx * bx + ny * by + nz * bz
    columns = (
        log(size, FORCE),
        log(peak, PRESSURE),
        log(net, FORCE),
        net / scale,
        log(size, FORCE) - log(force, FORCE),
        log(rate, RATE),
        log(net_rate, RATE),
        log(rate, RATE) - log(size, FORCE),
        divergence / scale,
        length_of(cx, cy, cz) / scale,
        along / (scale * (length_of(vx, vy, vz) + SPEED)),
        turned / (net * net_before + FORCE**2),
    )
    for k in range(len(columns)):
        out[k] = columns[k]


@compiled_network
@no_type_check
def log(value: float, floor: float) -> float:
    """Logarithm that is zero at zero and grows slowly below `floor`."""
    return math.log1p(value / floor)


@compiled_network
@no_type_check
def length_of(x: float, y: float, z: float) -> float:
    """Euclidean length of a vector."""
    return math.sqrt(x * x + y * y + z * z)


@compiled_network
@no_type_check
def extent(variance: float) -> float:
    """Standard deviation along an axis, as in `principal_extents` [cm]."""
    return math.sqrt(max(variance, 0.0) + FLAT**2) - FLAT


@compiled_network
@no_type_check
def eigenvalues(
    xx: float, yy: float, zz: float, xy: float, xz: float, yz: float
) -> tuple[float, float, float]:
    """Of a symmetric 3x3 matrix, largest first, by Jacobi's rotations.

    The closed form through a cosine loses half the digits where two of them are equal.
    """
    for _ in range(ROTATIONS):
        xx, yy, xy, xz, yz = rotated(xx, yy, xy, xz, yz)
        xx, zz, xz, xy, yz = rotated(xx, zz, xz, xy, yz)
        yy, zz, yz, xy, xz = rotated(yy, zz, yz, xy, xz)
    high, low = max(xx, yy), min(xx, yy)
    return max(high, zz), max(low, min(high, zz)), min(low, zz)


@compiled_network
@no_type_check
def rotated(
    pp: float, qq: float, pq: float, rp: float, rq: float
) -> tuple[float, float, float, float, float]:
    """One rotation in the plane of p and q that makes their product zero.

    Args:
        pp: diagonal element of p.
        qq: diagonal element of q.
        pq: the element between them.
        rp: between p and the third axis.
        rq: between q and the third axis.
    """
    if pq == 0.0:
        return pp, qq, pq, rp, rq
    half = 0.5 * (qq - pp) / pq
    t = 1.0 / (abs(half) + math.sqrt(half * half + 1.0))
    t = math.copysign(t, half)
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    return pp - t * pq, qq + t * pq, 0.0, c * rp - s * rq, s * rp + c * rq
