"""This module computes the features of contact graphs that the network takes."""

import numpy as np
from jaxtyping import Float

from eskin.live.graph import HISTORY, GraphBatch
from eskin.live.summary_kernels import LEVELS, summarise_all

NODE_SCALARS = ("active", "pressure", "rate", "age", "shear")
"""Columns of `compute_node_scalars`, each of order one."""

MAX_AGE = 2.0  # [s]

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
"""First columns of `compute_summary`: features of the pressure, then the history.

Length, breadth and depth are the standard deviations of the load along its principal
axes [cm]; the agreement of normals is 1 where all the load presses in one direction and
0 where it presses from all sides."""

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
"""Further columns of `compute_summary`: features of the shear."""


def compute_node_scalars(batch: GraphBatch) -> Float[np.ndarray, "node scalar"]:
    """Return the columns `NODE_SCALARS`, zero on inactive nodes except for the rate.

    Force is no column, since it depends on the size of a taxel. Areas weigh pooling and
    aggregation instead, so that skins of any density give the same.
    """
    rate = (batch.pressure - batch.before) / batch.seconds[batch.graph_index]
    columns = [
        batch.pressure > 0,
        np.arcsinh(batch.pressure / 2.0) / 3.0,
        np.arcsinh(rate / 50.0) / 2.0,
        np.minimum(batch.age, MAX_AGE) / MAX_AGE,
        np.linalg.norm(compress_shear(batch.shear), axis=1),
    ]
    return np.stack(columns, axis=1).astype(batch.pressure.dtype)


def compress_shear(shear: Float[np.ndarray, "node 3"]) -> Float[np.ndarray, "node 3"]:
    """Return vectors of the same direction whose length grows like a logarithm."""
    size = np.linalg.norm(shear, axis=1, keepdims=True)
    return shear * (np.arcsinh(size) / (3.0 * np.maximum(size, 1e-9)))


def compute_summary(
    batch: GraphBatch, shear: bool
) -> Float[np.ndarray, "graph feature"]:
    """Return invariant features of each graph as a whole: force, size, shape, speed.

    They are the columns `PRESSURE_SUMMARY`, and with shear those of `SHEAR_SUMMARY`.
    """
    features = len(PRESSURE_SUMMARY) + (len(SHEAR_SUMMARY) if shear else 0)
    out = np.empty((batch.size, features), batch.pressure.dtype)
    summarise_all(batch.for_kernels(), shear, out)
    return out
