"""This module computes the features of contact graphs that the network takes."""

import numpy as np
from jaxtyping import Float

from eskin.graph.batch import HISTORY, GraphBatch, segment_max, segment_sum

NODE_SCALARS = ("active", "pressure", "rate", "age", "shear")
"""Columns of `node_scalars`, each of order one."""

LONGEST_AGE = 2.0  # [s]


def node_scalars(batch: GraphBatch) -> Float[np.ndarray, "node scalar"]:
    """The columns of `NODE_SCALARS`, zero on inactive nodes but for rate.

    Force is left out on purpose: it would tell the size of a taxel, which pooling and
    aggregation take into account, so that skins of any density read alike.
    """
    rate = (batch.pressure - batch.before) / batch.seconds[batch.graph_index]
    columns = [
        batch.pressure > 0,
        np.arcsinh(batch.pressure / 2.0) / 3.0,
        np.arcsinh(rate / 50.0) / 2.0,
        np.minimum(batch.age, LONGEST_AGE) / LONGEST_AGE,
        np.linalg.norm(compressed(batch.shear), axis=1),
    ]
    return np.stack(columns, axis=1).astype(batch.pressure.dtype)


def compressed(shear: Float[np.ndarray, "node 3"]) -> Float[np.ndarray, "node 3"]:
    """The same directions, with a length that grows like its logarithm."""
    size = np.linalg.norm(shear, axis=1, keepdims=True)
    return shear * (np.arcsinh(size) / (3.0 * np.maximum(size, 1e-9)))


LEVELS = (20.0, 50.0, 90.0)
"""Pressures above which the area is measured [kPa]."""

PRESSURE_SUMMARY = (
    "force",
    "peak pressure",
    "area",
    *(f"area above {level:g} kPa" for level in LEVELS),
    "length",
    "breadth",
    "depth",
    "breadth to length",
    "agreement of normals",
    "loading rate",
    "unloading rate",
    "rate to force",
    "speed",
    "mean pressure",
    "spread of pressure",
    "concentration",
    "area to area pressed hard",
    *HISTORY,
)
"""Columns of `pressure_summary`."""

# Below these, values are not told apart: what sensors and hands leave to chance.
FORCE = 0.3  # [N]
RATE = 3.0  # [N/s]
SPEED = 0.5  # [cm/s]
AREA = 1.0  # [cm2]
PRESSURE = 1.0  # [kPa]
FLAT = 0.01  # [cm], so that rounding gives a flat patch no depth
N_PER_KPA_CM2 = 0.1
HISTORY_FLOORS = (0.5, 0.2, 1.0, 1.0, 1.0, FORCE, FORCE)
"""The same for the columns of `HISTORY`, in their units."""

PerGraph = Float[np.ndarray, "graph"]


def pressure_summary(batch: GraphBatch) -> Float[np.ndarray, "graph feature"]:
    """The columns of `PRESSURE_SUMMARY`."""
    p, a = batch.pressure, batch.areas
    force = total(p * a, batch) * N_PER_KPA_CM2
    area = total(a * (p > 0), batch)
    above = [total(a * (p > level), batch) for level in LEVELS]
    extents = principal_extents(batch)
    change = (p - batch.before) * a * N_PER_KPA_CM2
    loading = total(np.maximum(change, 0), batch) / batch.seconds
    unloading = total(np.maximum(-change, 0), batch) / batch.seconds
    mean = total(p * a, batch) / (area + AREA)
    square = total(p * p * a, batch) / (area + AREA)
    columns = [
        log(force, FORCE),
        log(segment_max(p, batch.offsets), PRESSURE),
        log(area, AREA),
        *(log(part, AREA) for part in above),
        *extents.T,
        extents[:, 1] / (extents[:, 0] + 0.1),
        agreement_of_normals(batch),
        log(loading, RATE),
        log(unloading, RATE),
        log(loading + unloading, RATE) - log(force, FORCE),
        log(np.linalg.norm(velocity(batch), axis=1), SPEED),
        mean / 50.0,
        np.sqrt(np.maximum(square - mean**2, 0.0)) / 50.0,
        log(square * area * N_PER_KPA_CM2**2, FORCE * 0.1) - 2 * log(force, FORCE),
        log(area, AREA) - log(above[-1], AREA),
        *(log(h, f) for h, f in zip(batch.history.T, HISTORY_FLOORS, strict=True)),
    ]
    return np.stack(columns, axis=1).astype(batch.pressure.dtype)


def total(values: Float[np.ndarray, "node"], batch: GraphBatch) -> PerGraph:
    """Sum over each graph."""
    return segment_sum(values, batch.offsets)


def log(values: PerGraph, floor: float) -> PerGraph:
    """Logarithm that is zero at zero and grows slowly below `floor`."""
    return np.log1p(values / floor)


def centres(
    weights: Float[np.ndarray, "node"], batch: GraphBatch
) -> Float[np.ndarray, "graph 3"]:
    """Weighted mean position of each graph [cm]; zero where nothing weighs.

    In float64, since speeds are made of small differences of it.
    """
    heavy = weights.astype(np.float64)[:, None]
    moments = segment_sum(heavy * batch.positions, batch.offsets)
    return moments / np.maximum(total(weights, batch), 1e-6)[:, None]


def principal_extents(batch: GraphBatch) -> Float[np.ndarray, "graph 3"]:
    """Standard deviations of the load along its principal axes, largest first [cm]."""
    weights = batch.pressure * batch.areas
    offset = batch.positions - centres(weights, batch)[batch.graph_index]
    outer = weights[:, None, None] * offset[:, :, None] * offset[:, None, :]
    spread = segment_sum(outer, batch.offsets)
    spread /= np.maximum(total(weights, batch), 1e-6)[:, None, None]
    variances = np.maximum(np.linalg.eigvalsh(spread), 0.0)[:, ::-1]
    return np.sqrt(variances + FLAT**2) - FLAT


def agreement_of_normals(batch: GraphBatch) -> PerGraph:
    """1 where all the load presses one way, 0 where it presses from all around."""
    weights = batch.pressure * batch.areas
    resultant = segment_sum(weights[:, None] * batch.normals, batch.offsets)
    return np.linalg.norm(resultant, axis=1) / np.maximum(total(weights, batch), 1e-6)


def velocity(batch: GraphBatch) -> Float[np.ndarray, "graph 3"]:
    """How the centre of the load moves over the skin [cm/s]; zero at first touch.

    The earlier load is placed where its taxels are now, so a load that rides on a
    moving link does not seem to move.
    """
    now, before = batch.pressure * batch.areas, batch.before * batch.areas
    both = (total(now, batch) > 0) & (total(before, batch) > 0)
    moved = centres(now, batch) - centres(before, batch)
    return np.where(both[:, None], moved / batch.seconds[:, None], 0.0)


SHEAR_SUMMARY = (
    "shear force",
    "peak shear",
    "net shear",
    "agreement of shear",
    "shear to normal force",
    "shear rate",
    "net shear rate",
    "shear rate to shear",
    "divergence",
    "curl",
    "shear along the motion",
    "turning of net shear",
)
"""Columns of `shear_summary`."""

NEAR = 0.3  # [cm] from the centre, where outward is no clear direction


def shear_summary(batch: GraphBatch) -> Float[np.ndarray, "graph feature"]:
    """The columns of `SHEAR_SUMMARY`: invariants as in `pressure_summary`."""
    weights = batch.areas.astype(np.float64)[:, None] * N_PER_KPA_CM2
    s, earlier = batch.shear * weights, batch.shear_before * weights
    change = (s - earlier) / batch.seconds[batch.graph_index][:, None]
    size = total(length(s), batch)
    rate = total(length(change), batch)
    net, net_before = vector_sum(s, batch), vector_sum(earlier, batch)
    normal_force = total(batch.pressure * batch.areas, batch) * N_PER_KPA_CM2
    outward = outward_directions(batch)
    v = velocity(batch)
    scale = size + FORCE
    columns = [
        log(size, FORCE),
        log(segment_max(length(batch.shear), batch.offsets), PRESSURE),
        log(length(net), FORCE),
        length(net) / scale,
        log(size, FORCE) - log(normal_force, FORCE),
        log(rate, RATE),
        log(length(vector_sum(change, batch)), RATE),
        log(rate, RATE) - log(size, FORCE),
        total((s * outward).sum(axis=1), batch) / scale,
        length(vector_sum(np.cross(outward, s), batch)) / scale,
        (net * v).sum(axis=1) / (scale * (length(v) + SPEED)),
        (net * net_before).sum(axis=1) / (length(net) * length(net_before) + FORCE**2),
    ]
    return np.stack(columns, axis=1).astype(batch.pressure.dtype)


def length(vectors: Float[np.ndarray, "row 3"]) -> Float[np.ndarray, "row"]:
    """Euclidean length of each row."""
    return np.linalg.norm(vectors, axis=1)


def vector_sum(
    vectors: Float[np.ndarray, "node 3"], batch: GraphBatch
) -> Float[np.ndarray, "graph 3"]:
    """Sum of vectors over each graph."""
    return segment_sum(vectors, batch.offsets)


def outward_directions(batch: GraphBatch) -> Float[np.ndarray, "node 3"]:
    """Unit vectors away from the centre of the load, shrunk to zero close to it."""
    centre = centres(batch.pressure * batch.areas, batch)[batch.graph_index]
    offset = batch.positions - centre
    return offset / (length(offset)[:, None] + NEAR)
