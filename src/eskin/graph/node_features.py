"""What each node brings to the network beside its vectors."""

import numpy as np
from jaxtyping import Float

from eskin.graph.batch import GraphBatch

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
