"""Compiled kernels that compute the summary of each contact graph.

Sums are in float64, over one node after the other. Every feature is invariant to
motions and mirror images of the whole robot, depends on forces and areas rather than on
taxels, so that density does not matter, and is logarithmic where people differ by
factors.
"""

import math

import numpy as np
from jaxtyping import Float

from eskin.compiled import compiled_fastmath
from eskin.live.graph import GraphBatch

LEVELS = (20.0, 50.0, 90.0)
"""Pressures above which the area is measured [kPa]."""

# Scales below which differences are noise of sensors and hands.
FORCE = 0.3  # [N]
RATE = 3.0  # [N/s]
SPEED = 0.5  # [cm/s]
AREA = 1.0  # [cm2]
PRESSURE = 1.0  # [kPa]
FLAT = 0.01  # [cm], so that rounding errors give a flat patch no depth
NEAR = 0.3  # [cm] from the centre, where the outward direction is ill-defined
HISTORY_FLOORS = (0.5, 0.2, 1.0, 1.0, 1.0, FORCE, FORCE)
"""The same scales for the columns of `eskin.live.HISTORY`, in their units."""

N_PER_KPA_CM2 = 0.1
MIN_WEIGHT = 1e-6
"""Load below which its centre is not defined [kPa cm2]."""
SWEEPS = 5
"""Sweeps of Jacobi's method; four bring 3x3 matrices to float64's last digit."""

Vector = tuple[float, float, float]
LoadMotion = tuple[float, Vector, Vector]
"""Force of the load [N], its centre [cm] and its velocity [cm/s]."""
Features = Float[np.ndarray, "feature"]


@compiled_fastmath
def summarise_all(
    graphs: GraphBatch, shear: bool, out: Float[np.ndarray, "graph feature"]
) -> None:
    """Write the summary of every graph; see `summarise`."""
    for index in range(len(graphs.seconds)):
        summarise(graphs, index, shear, out[index])


@compiled_fastmath
def summarise(graphs: GraphBatch, index: int, shear: bool, out: Features) -> None:
    """Write the summary of one of some graphs: the columns of `PRESSURE_SUMMARY`.

    With shear those of `SHEAR_SUMMARY` follow.
    """
    motion = compute_load_motion(graphs, index)
    column = summarise_pressure(graphs, index, motion, out)
    for k in range(len(HISTORY_FLOORS)):
        out[column + k] = log(graphs.history[index, k], HISTORY_FLOORS[k])
    if shear:
        column += len(HISTORY_FLOORS)
        summarise_shear(graphs, index, motion, out[column:])


@compiled_fastmath
def compute_load_motion(graphs: GraphBatch, index: int) -> LoadMotion:
    """Return the motion of the load of a graph.

    The earlier load is placed where its taxels are now, so a load that rides on a
    moving link does not seem to move. The velocity is zero at first contact.
    """
    first = graphs.offsets[index]
    end = graphs.offsets[index + 1]
    seconds = np.float64(graphs.seconds[index])
    pressure = graphs.pressure[first:end]
    previous = graphs.before[first:end]
    areas = graphs.areas[first:end]
    positions = graphs.positions[first:end]
    now = 0.0
    before = 0.0
    x = 0.0
    y = 0.0
    z = 0.0
    x_before = 0.0
    y_before = 0.0
    z_before = 0.0
    for i in range(len(pressure)):
        p = pressure[i]
        p_before = previous[i]
        if p == 0.0 and p_before == 0.0:
            continue
        weight = np.float64(p) * areas[i]
        weight_before = np.float64(p_before) * areas[i]
        now += weight
        before += weight_before
        x += weight * positions[i, 0]
        y += weight * positions[i, 1]
        z += weight * positions[i, 2]
        x_before += weight_before * positions[i, 0]
        y_before += weight_before * positions[i, 1]
        z_before += weight_before * positions[i, 2]
    divisor = max(now, MIN_WEIGHT)
    divisor_before = max(before, MIN_WEIGHT)
    centre = (x / divisor, y / divisor, z / divisor)
    velocity = (0.0, 0.0, 0.0)
    if now > 0.0 and before > 0.0:
        velocity = (
            (centre[0] - x_before / divisor_before) / seconds,
            (centre[1] - y_before / divisor_before) / seconds,
            (centre[2] - z_before / divisor_before) / seconds,
        )
    return now * N_PER_KPA_CM2, centre, velocity


@compiled_fastmath
def summarise_pressure(
    graphs: GraphBatch, index: int, motion: LoadMotion, out: Features
) -> int:
    """Write the features of the pressure, and return their number."""
    force, centre, velocity = motion
    first = graphs.offsets[index]
    end = graphs.offsets[index + 1]
    seconds = np.float64(graphs.seconds[index])
    pressure = graphs.pressure[first:end]
    previous = graphs.before[first:end]
    areas = graphs.areas[first:end]
    positions = graphs.positions[first:end]
    normals = graphs.normals[first:end]
    peak = 0.0
    area = 0.0
    squares = 0.0
    loading = 0.0
    unloading = 0.0
    low = 0.0
    middle = 0.0
    high = 0.0
    nx = 0.0
    ny = 0.0
    nz = 0.0
    xx = 0.0
    yy = 0.0
    zz = 0.0
    xy = 0.0
    xz = 0.0
    yz = 0.0
    for i in range(len(pressure)):
        p = np.float64(pressure[i])
        a = np.float64(areas[i])
        change = (p - previous[i]) * a * N_PER_KPA_CM2
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
        nx += weight * normals[i, 0]
        ny += weight * normals[i, 1]
        nz += weight * normals[i, 2]
        x = positions[i, 0] - centre[0]
        y = positions[i, 1] - centre[1]
        z = positions[i, 2] - centre[2]
        xx = xx + weight * x * x
        yy = yy + weight * y * y
        zz = zz + weight * z * z
        xy = xy + weight * x * y
        xz = xz + weight * x * z
        yz = yz + weight * y * z
    total = force / N_PER_KPA_CM2
    div = max(total, MIN_WEIGHT)
    variances = compute_eigenvalues(
        xx / div, yy / div, zz / div, xy / div, xz / div, yz / div
    )
    loading = loading / seconds
    unloading = unloading / seconds
    mean = total / (area + AREA)
    square = squares / (area + AREA)
    length = compute_extent(variances[0])
    breadth = compute_extent(variances[1])
    speed = norm(velocity[0], velocity[1], velocity[2])
    concentration = square * area * N_PER_KPA_CM2**2
    columns = (
        log(force, FORCE),
        log(peak, PRESSURE),
        log(area, AREA),
        log(low, AREA),
        log(middle, AREA),
        log(high, AREA),
        length,
        breadth,
        compute_extent(variances[2]),
        breadth / (length + 0.1),
        norm(nx, ny, nz) / div,
        log(loading, RATE),
        log(unloading, RATE),
        log(loading + unloading, RATE) - log(force, FORCE),
        log(speed, SPEED),
        mean / 50.0,
        math.sqrt(max(square - mean * mean, 0.0)) / 50.0,
        log(concentration, FORCE * 0.1) - 2.0 * log(force, FORCE),
        log(area, AREA) - log(high, AREA),
    )
    for k in range(len(columns)):
        out[k] = columns[k]
    return len(columns)


@compiled_fastmath
def summarise_shear(
    graphs: GraphBatch, index: int, motion: LoadMotion, out: Features
) -> None:
    """Write the features of the shear."""
    force, centre, velocity = motion
    first = graphs.offsets[index]
    end = graphs.offsets[index + 1]
    seconds = np.float64(graphs.seconds[index])
    areas = graphs.areas[first:end]
    positions = graphs.positions[first:end]
    shear = graphs.shear[first:end]
    shear_before = graphs.shear_before[first:end]
    size = 0.0
    peak = 0.0
    rate = 0.0
    divergence = 0.0
    nx = 0.0
    ny = 0.0
    nz = 0.0
    bx = 0.0
    by = 0.0
    bz = 0.0
    cx = 0.0
    cy = 0.0
    cz = 0.0
    for i in range(len(areas)):
        a = np.float64(areas[i]) * N_PER_KPA_CM2
        s = shear[i]
        earlier = shear_before[i]
        peak = max(peak, norm(s[0], s[1], s[2]))
        sx = s[0] * a
        sy = s[1] * a
        sz = s[2] * a
        ex = earlier[0] * a
        ey = earlier[1] * a
        ez = earlier[2] * a
        size += norm(sx, sy, sz)
        rate += norm(sx - ex, sy - ey, sz - ez) / seconds
        nx = nx + sx
        ny = ny + sy
        nz = nz + sz
        bx = bx + ex
        by = by + ey
        bz = bz + ez
        x = positions[i, 0] - centre[0]
        y = positions[i, 1] - centre[1]
        z = positions[i, 2] - centre[2]
        outward = 1.0 / (norm(x, y, z) + NEAR)
        divergence += (sx * x + sy * y + sz * z) * outward
        cx += (y * sz - z * sy) * outward
        cy += (z * sx - x * sz) * outward
        cz += (x * sy - y * sx) * outward
    scale = size + FORCE
    net = norm(nx, ny, nz)
    net_before = norm(bx, by, bz)
    net_rate = norm(nx - bx, ny - by, nz - bz) / seconds
    vx = velocity[0]
    vy = velocity[1]
    vz = velocity[2]
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
        norm(cx, cy, cz) / scale,
        along / (scale * (norm(vx, vy, vz) + SPEED)),
        turned / (net * net_before + FORCE**2),
    )
    for k in range(len(columns)):
        out[k] = columns[k]


@compiled_fastmath
def log(value: float, floor: float) -> float:
    """Return a logarithm that is zero at zero and grows slowly below `floor`."""
    return math.log1p(value / floor)


@compiled_fastmath
def norm(x: float, y: float, z: float) -> float:
    """Return the Euclidean norm of a vector."""
    return math.sqrt(x * x + y * y + z * z)


@compiled_fastmath
def compute_extent(variance: float) -> float:
    """Return the standard deviation along a principal axis [cm]."""
    return math.sqrt(max(variance, 0.0) + FLAT**2) - FLAT


@compiled_fastmath
def compute_eigenvalues(
    xx: float, yy: float, zz: float, xy: float, xz: float, yz: float
) -> tuple[float, float, float]:
    """Return the eigenvalues of a symmetric 3x3 matrix, largest first, by Jacobi.

    The closed form with a cosine loses half the digits where two of them are equal.
    """
    for _ in range(SWEEPS):
        xx, yy, xy, xz, yz = rotate(xx, yy, xy, xz, yz)
        xx, zz, xz, xy, yz = rotate(xx, zz, xz, xy, yz)
        yy, zz, yz, xy, xz = rotate(yy, zz, yz, xy, xz)
    high, low = max(xx, yy), min(xx, yy)
    return max(high, zz), max(low, min(high, zz)), min(low, zz)


@compiled_fastmath
def rotate(
    pp: float, qq: float, pq: float, rp: float, rq: float
) -> tuple[float, float, float, float, float]:
    """Rotate a matrix in the plane of p and q so that its element pq is zero.

    Arguments are its elements; r is the third axis, whose diagonal does not change.
    """
    if pq == 0.0:
        return pp, qq, pq, rp, rq
    half = 0.5 * (qq - pp) / pq
    t = 1.0 / (abs(half) + math.sqrt(half * half + 1.0))
    t = math.copysign(t, half)
    c = 1.0 / math.sqrt(t * t + 1.0)
    s = t * c
    return pp - t * pq, qq + t * pq, 0.0, c * rp - s * rq, s * rp + c * rq
