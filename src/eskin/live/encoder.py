"""The encoder's weights as its kernels take them, and their working memory."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from eskin.graph import NODE_SCALARS
from eskin.live.kernels import BLOCK
from eskin.model.file import EDGE_SCALARS, layer_shapes

Weights = Mapping[str, np.ndarray]
"""Parameters by name, as in the state of the torch network."""


class EncoderWeights(NamedTuple):
    """Parameters of `eskin.nn.Encoder`, those of its layers stacked.

    Matrices are ([layer,] input, output), the transpose of torch's, so that the
    channels of an output lie side by side. The last layer moves nothing: zeros.
    """

    embed_weight: np.ndarray
    embed_bias: np.ndarray
    norm_weight: np.ndarray
    norm_bias: np.ndarray
    of_target_weight: np.ndarray
    of_target_bias: np.ndarray
    of_source_weight: np.ndarray
    of_edge_weight: np.ndarray
    message_weight: np.ndarray
    message_bias: np.ndarray
    move_weight: np.ndarray
    update_hidden_weight: np.ndarray
    update_hidden_bias: np.ndarray
    update_out_weight: np.ndarray
    update_out_bias: np.ndarray
    pool_weight: np.ndarray
    pool_bias: np.ndarray


class EncoderMemory(NamedTuple):
    """What the encoder writes to while it looks at one graph.

    A *row* is a node with features of its own: first the active nodes, which hear
    others, then those that are neither active nor at rest, and last one for all that
    are at rest, whose features nothing tells apart.
    """

    x: np.ndarray
    """(node, 3) coordinates in units of `LENGTH_CM`."""
    shear: np.ndarray
    """(node, 3) compressed shear."""
    row: np.ndarray
    """(node) the row of each node that matters."""
    nodes: np.ndarray
    """(row) the node of each row."""
    firsts: np.ndarray
    """(row and one) first edge to each active node."""
    sources: np.ndarray
    """(edge) node that is heard."""
    source_rows: np.ndarray
    """(edge) its row."""
    shares: np.ndarray
    """(edge) share of that node in the area that its target hears."""
    scalars: np.ndarray
    """(row, scalar) columns of `eskin.graph.NODE_SCALARS`."""
    v: np.ndarray
    """(row, width) features."""
    u: np.ndarray
    """(row, width) normalised features."""
    of_source: np.ndarray
    """(row, width) what each says."""
    of_target: np.ndarray
    """(row, width) how each hears."""
    heard: np.ndarray
    """(row, width) mean message."""
    moved: np.ndarray
    """(row, 3) how far each goes."""
    r: np.ndarray
    """(block, 3) from source to target, of the edges to a few targets."""
    edge: np.ndarray
    """(block, edge scalar) invariants of those edges."""
    hidden: np.ndarray
    """(block, width) their messages half made."""
    messages: np.ndarray
    """(block, width) their messages."""
    ways: np.ndarray
    """(block) how much `r` of each counts in moving its target."""
    pooled: np.ndarray
    """(one, 2 width) maximum and mean over the active nodes."""


def encoder_weights(weights: Weights, layers: int) -> EncoderWeights:
    """The parameters whose names begin with `encoder.`."""
    width = len(weights["encoder.embed.bias"])
    parts = {
        "embed_weight": transposed(weights["encoder.embed.weight"]),
        "embed_bias": weights["encoder.embed.bias"],
        "pool_weight": weights["encoder.norm.weight"],
        "pool_bias": weights["encoder.norm.bias"],
    }
    for name, shape in layer_shapes(width, last=False).items():
        stack = np.zeros((layers, *reversed(shape)), np.float32)
        for n in range(layers):
            if f"encoder.layers.{n}.{name}" in weights:
                stack[n] = weights[f"encoder.layers.{n}.{name}"].T
        parts[name.replace(".", "_")] = stack
    parts["move_weight"] = parts["move_weight"][:, :, 0]
    return EncoderWeights(**{k: np.ascontiguousarray(w) for k, w in parts.items()})


def encoder_memory(nodes: int, neighbours: int, width: int) -> EncoderMemory:
    """Memory for graphs of so many nodes with so many neighbours each."""

    def real(*shape: int) -> np.ndarray:
        return np.empty(shape, np.float32)

    def whole(size: int) -> np.ndarray:
        return np.empty(size, np.int32)

    edges, block = nodes * neighbours, max(BLOCK, neighbours)
    return EncoderMemory(
        x=real(nodes, 3),
        shear=np.zeros((nodes, 3), np.float32),
        row=whole(nodes),
        nodes=whole(nodes),
        firsts=whole(nodes + 1),
        sources=whole(edges),
        source_rows=whole(edges),
        shares=real(edges),
        scalars=real(nodes, len(NODE_SCALARS)),
        v=real(nodes, width),
        u=real(nodes, width),
        of_source=real(nodes, width),
        of_target=real(nodes, width),
        heard=real(nodes, width),
        moved=real(nodes, 3),
        r=real(block, 3),
        edge=real(block, EDGE_SCALARS),
        hidden=real(block, width),
        messages=real(block, width),
        ways=real(block),
        pooled=real(1, 2 * width),
    )


def transposed(weight: np.ndarray) -> np.ndarray:
    """A matrix of torch as (input, output)."""
    return np.ascontiguousarray(weight.T)
