"""What the shear of a touch is as a whole at one reading."""

import numpy as np
from jaxtyping import Float

from eskin.graph.batch import GraphBatch
from eskin.graph.segments import segment_max, segment_sum
from eskin.graph.summary import (
    FORCE,
    N_PER_KPA_CM2,
    PRESSURE,
    RATE,
    SPEED,
    centres,
    log,
    total,
    velocity,
)

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
