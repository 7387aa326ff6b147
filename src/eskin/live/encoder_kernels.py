"""Compiled kernels that do what `eskin.learn.nn.Encoder` does, for one graph.

Products of matrices go through BLAS, everything else is loops along channels.
"""

import math
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int

from eskin.compiled import compiled, compiled_fastmath
from eskin.live.graph import GraphBatch
from eskin.live.graph_features import MAX_AGE
from eskin.live.graph_kernels import NO_NODE
from eskin.live.model_config import LENGTH_CM

PER_LENGTH = np.float32(1.0 / LENGTH_CM)
TWO = np.float32(2.0)
BLOCK = 256
"""Rows multiplied at once: few enough that they and their products fit in the cache and
that BLAS uses one thread, which is faster."""

EPSILON = np.float32(1e-5)
"""Added to the variance in a normalisation, as in torch."""

# exp2 by a polynomial on [-0.5, 0.5], to a relative error of 2e-7.
LOG2_E = np.float32(1.4426950408889634)
MAX_EXPONENT = np.float32(80.0)  # where exp is still a float32 on both sides
ZERO = np.float32(0.0)
ONE = np.float32(1.0)
E0 = np.float32(1.000000075)
E1 = np.float32(0.693147188)
E2 = np.float32(0.2402210749)
E3 = np.float32(0.05550357114)
E4 = np.float32(0.009676031918)
E5 = np.float32(0.001339086336)
# Adding this to a small number rounds it to a whole one, in the lowest bits.
ROUNDER = np.float32(1.5 * 2**23)
EXPONENT_SHIFT = np.int32(23)

Channels = Float[np.ndarray, "channel"]
Rows = Float[np.ndarray, "row channel"]
Edges = Int[np.ndarray, "edge"]


class EncoderWeights(NamedTuple):
    """Holds the parameters of the encoder, its layers stacked.

    Matrices are ([layer,] input, output), the transpose of torch's, so that the
    channels of an output lie side by side. The last layer updates no coordinates: its
    `move_weight` is zero.
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


class EncoderWorkspace(NamedTuple):
    """A workspace is the memory in which the encoder works on one graph.

    A *row* is a node with features of its own: first the active nodes, which receive
    messages, then those that are neither active nor at rest, and one row for all nodes
    at rest, whose features are equal.
    """

    x: Float[np.ndarray, "node 3"]  # coordinates in units of `LENGTH_CM`
    shear: Float[np.ndarray, "node 3"]  # compressed shear
    row: Int[np.ndarray, "node"]  # row of each active node or source
    nodes: Int[np.ndarray, "row"]  # node of each row
    first_edge: Int[np.ndarray, "row+1"]  # first edge to each active node
    sources: Int[np.ndarray, "edge"]  # node
    source_rows: Int[np.ndarray, "edge"]  # row
    edge_weights: Float[np.ndarray, "edge"]  # share in the area of the target's sources
    scalars: Float[np.ndarray, "row scalar"]  # columns `eskin.live.NODE_SCALARS`
    v: Float[np.ndarray, "row width"]  # features
    u: Float[np.ndarray, "row width"]  # normalised features
    of_source: Float[np.ndarray, "row width"]  # contribution of a source to messages
    of_target: Float[np.ndarray, "row width"]  # contribution of a target to messages
    messages: Float[np.ndarray, "row width"]  # aggregated messages
    coord_update: Float[np.ndarray, "row 3"]  # update of the coordinates
    # For a block of edges, to a few targets:
    r: Float[np.ndarray, "block 3"]  # vector from source to target
    edge_features: Float[np.ndarray, "block scalar"]  # invariants
    hidden: Float[np.ndarray, "block width"]  # first layer of the messages
    edge_messages: Float[np.ndarray, "block width"]  # messages
    coord_weights: Float[np.ndarray, "block"]  # weight of `r` in the coordinate update
    pooled: Float[np.ndarray, "1 channel"]  # maximum and mean over the active nodes


@compiled(fastmath={"contract", "nsz"})
def exp_negative(x: float) -> np.float32:
    """Return exp(-x) without a library call, so that loops over it are vectorised.

    Its sums must not be reordered: it rounds by adding and subtracting `ROUNDER`.
    """
    z = min(max(x, -MAX_EXPONENT), MAX_EXPONENT)
    shifted = np.float32(ROUNDER - z * LOG2_E)
    f = (ROUNDER - shifted) - z * LOG2_E
    power = np.float32(((((E5 * f + E4) * f + E3) * f + E2) * f + E1) * f + E0)
    exponent = np.int32(shifted.view(np.int32) << EXPONENT_SHIFT)
    return np.int32(power.view(np.int32) + exponent).view(np.float32)


@compiled_fastmath(inline="always")
def sigmoid(x: float) -> float:
    """Return 1 / (1 + exp(-x))."""
    return ONE / (ONE + exp_negative(x))


@compiled_fastmath(inline="always")
def silu(x: float) -> float:
    """Return the product of x and its sigmoid."""
    return x / (ONE + exp_negative(x))


@compiled_fastmath
def matmul(x: Rows, weight: Rows, out: Rows) -> None:
    """Write x @ weight to `out`."""
    for first in range(0, len(x), BLOCK):
        last = min(first + BLOCK, len(x))
        np.dot(x[first:last], weight, out[first:last])


@compiled_fastmath
def add_bias(x: Rows, bias: Channels) -> None:
    """Add the same bias to every row."""
    for i in range(x.shape[0]):
        for c in range(x.shape[1]):
            x[i, c] += bias[c]


@compiled_fastmath
def add_rows(x: Rows, out: Rows) -> None:
    """Add `x` to `out`."""
    for i in range(x.shape[0]):
        for c in range(x.shape[1]):
            out[i, c] += x[i, c]


@compiled_fastmath
def activate(x: Rows, bias: Channels) -> None:
    """Replace each row by silu(row + bias)."""
    for i in range(x.shape[0]):
        for c in range(x.shape[1]):
            x[i, c] = silu(x[i, c] + bias[c])


@compiled_fastmath
def layer_norm(x: Rows, scale: Channels, shift: Channels, out: Rows) -> None:
    """Normalise each row to zero mean and unit variance, then scale and shift it."""
    rows, channels = x.shape
    for i in range(rows):
        mean = ZERO
        for c in range(channels):
            mean += x[i, c]
        mean /= np.float32(channels)
        variance = ZERO
        for c in range(channels):
            variance += (x[i, c] - mean) ** 2
        inverse = ONE / np.sqrt(variance / np.float32(channels) + EPSILON)
        for c in range(channels):
            out[i, c] = (x[i, c] - mean) * inverse * scale[c] + shift[c]


@compiled_fastmath
def encode(
    graph: GraphBatch,
    shear: bool,
    weights: EncoderWeights,
    workspace: EncoderWorkspace,
    out: Channels,
) -> None:
    """Write the embedding of a batch of one graph; zeros where nothing is active."""
    targets = find_targets(graph, workspace)
    if targets == 0:
        for c in range(len(out)):
            out[c] = ZERO
        return
    edges = find_edges(graph, targets, workspace)
    write_coordinates(graph, shear, workspace)
    rows = embed_nodes(graph, targets, edges, weights, workspace)
    for layer in range(len(weights.message_weight)):
        run_layer(layer, graph, shear, targets, rows, weights, workspace)
    pool_nodes(graph, targets, weights, workspace, out)


@compiled_fastmath
def find_targets(graph: GraphBatch, workspace: EncoderWorkspace) -> int:
    """List the active nodes, the targets, and return their number."""
    targets = 0
    for node in range(graph.offsets[1]):
        workspace.row[node] = NO_NODE
        if graph.pressure[node] > 0.0:
            workspace.row[node] = targets
            workspace.nodes[targets] = node
            targets += 1
    return targets


@compiled_fastmath
def find_edges(graph: GraphBatch, targets: int, workspace: EncoderWorkspace) -> int:
    """List the sources of each target, and return the number of edges."""
    sources = workspace.sources
    edge_weights = workspace.edge_weights
    edges = 0
    for i in range(targets):
        node = workspace.nodes[i]
        workspace.first_edge[i] = edges
        area = ZERO
        for k in range(graph.neighbours.shape[1]):
            source = graph.neighbours[node, k]
            if source >= 0:
                sources[edges] = source
                edge_weights[edges] = graph.areas[source]
                area += graph.areas[source]
                edges += 1
        for e in range(workspace.first_edge[i], edges):
            edge_weights[e] /= max(area, np.float32(1e-6))
    workspace.first_edge[targets] = edges
    return edges


@compiled_fastmath
def write_coordinates(
    graph: GraphBatch, shear: bool, workspace: EncoderWorkspace
) -> None:
    """Write coordinates and, if the network uses it, compressed shear."""
    for node in range(graph.offsets[1]):
        for d in range(3):
            workspace.x[node, d] = graph.positions[node, d] * PER_LENGTH
        if shear:
            size = math.sqrt(squared_norm(graph.shear[node]))
            scale = np.float32(arcsinh(size) / (3.0 * max(size, 1e-9)))
            for d in range(3):
                workspace.shear[node, d] = graph.shear[node, d] * scale


@compiled_fastmath
def embed_nodes(
    graph: GraphBatch,
    targets: int,
    edges: int,
    weights: EncoderWeights,
    workspace: EncoderWorkspace,
) -> int:
    """Write the first features of every row, and return the number of rows."""
    for i in range(targets):
        write_node_features(graph, workspace.nodes[i], i, workspace)
    rows = targets
    rest = NO_NODE
    for e in range(edges):
        node = workspace.sources[e]
        if workspace.row[node] == NO_NODE:
            at_rest = write_node_features(graph, node, rows, workspace)
            if at_rest and rest != NO_NODE:
                workspace.row[node] = rest
            else:
                workspace.row[node] = rows
                rest = rows if at_rest else rest
                rows += 1
        workspace.source_rows[e] = workspace.row[node]
    matmul(workspace.scalars[:rows], weights.embed_weight, workspace.v[:rows])
    activate(workspace.v[:rows], weights.embed_bias)
    return rows


@compiled_fastmath
def write_node_features(
    graph: GraphBatch, node: int, row: int, workspace: EncoderWorkspace
) -> bool:
    """Write the scalars of a node to a row, and return whether all are zero."""
    scalars = workspace.scalars
    p = graph.pressure[node]
    before = graph.before[node]
    s = squared_norm(workspace.shear[node])
    if p == 0.0 and before == 0.0 and s == 0.0 and graph.age[node] == 0.0:
        for k in range(scalars.shape[1]):
            scalars[row, k] = ZERO
        return True
    rate = (p - before) / np.float64(graph.seconds[0])
    scalars[row, 0] = p > 0.0
    scalars[row, 1] = arcsinh(p / 2.0) / 3.0
    scalars[row, 2] = arcsinh(rate / 50.0) / 2.0
    scalars[row, 3] = min(graph.age[node], MAX_AGE) / MAX_AGE
    scalars[row, 4] = math.sqrt(s)
    return False


@compiled_fastmath
def run_layer(
    layer: int,
    graph: GraphBatch,
    shear: bool,
    targets: int,
    rows: int,
    weights: EncoderWeights,
    workspace: EncoderWorkspace,
) -> None:
    """Run one `eskin.learn.nn.EquivariantLayer`."""
    u = workspace.u[:rows]
    of_target = workspace.of_target[:targets]
    messages = workspace.messages[:targets]
    width = u.shape[1]
    layer_norm(
        workspace.v[:rows], weights.norm_weight[layer], weights.norm_bias[layer], u
    )
    matmul(u, weights.of_source_weight[layer], workspace.of_source[:rows])
    matmul(u[:targets], weights.of_target_weight[layer], of_target)
    add_bias(of_target, weights.of_target_bias[layer])
    for i in range(targets):
        for d in range(3):
            workspace.coord_update[i, d] = ZERO
        for c in range(width):
            messages[i, c] = ZERO
    aggregate(layer, graph, shear, targets, weights, workspace)
    hidden = workspace.of_source[:targets]
    matmul(u[:targets], weights.update_hidden_weight[layer, :width], hidden)
    matmul(messages, weights.update_hidden_weight[layer, width:], of_target)
    add_rows(of_target, hidden)
    activate(hidden, weights.update_hidden_bias[layer])
    matmul(hidden, weights.update_out_weight[layer], of_target)
    add_bias(of_target, weights.update_out_bias[layer])
    add_rows(of_target, workspace.v[:targets])
    for i in range(targets):
        node = workspace.nodes[i]
        for d in range(3):
            workspace.x[node, d] += workspace.coord_update[i, d]


@compiled_fastmath
def aggregate(
    layer: int,
    graph: GraphBatch,
    shear: bool,
    targets: int,
    weights: EncoderWeights,
    workspace: EncoderWorkspace,
) -> None:
    """Aggregate the messages to every target, in blocks of about `BLOCK` edges."""
    begin = 0
    while begin < targets:
        end = begin + 1
        first = workspace.first_edge[begin]
        while end < targets and workspace.first_edge[end + 1] - first <= BLOCK:
            end += 1
        aggregate_block(layer, graph, shear, begin, end, weights, workspace)
        begin = end


@compiled_fastmath
def aggregate_block(
    layer: int,
    graph: GraphBatch,
    shear: bool,
    begin: int,
    end: int,
    weights: EncoderWeights,
    workspace: EncoderWorkspace,
) -> None:
    """Aggregate the messages to the targets from `begin` to before `end`."""
    first_edge = workspace.first_edge[begin : end + 1]
    edges = first_edge[-1] - first_edge[0]
    sources = workspace.source_rows[first_edge[0] : first_edge[-1]]
    shares = workspace.edge_weights[first_edge[0] : first_edge[-1]]
    hidden = workspace.hidden[:edges]
    messages = workspace.edge_messages[:edges]
    of_target = workspace.of_target[begin:end]
    out = workspace.messages[begin:end]
    write_edge_features(graph, shear, begin, end, workspace)
    np.dot(workspace.edge_features[:edges], weights.of_edge_weight[layer], hidden)
    add_node_terms(first_edge, sources, of_target, workspace.of_source, hidden)
    np.dot(hidden, weights.message_weight[layer], messages)
    sum_messages(first_edge, shares, weights.message_bias[layer], messages, out)
    if layer + 1 < len(weights.message_weight):  # the last layer updates no coordinates
        coord_weights = workspace.coord_weights[:edges]
        updates = workspace.coord_update[begin:end]
        np.dot(messages, weights.move_weight[layer], coord_weights)
        sum_coord_updates(first_edge, shares, coord_weights, workspace.r, updates)


@compiled_fastmath
def add_node_terms(
    first_edge: Edges, sources: Edges, of_target: Rows, of_source: Rows, hidden: Rows
) -> None:
    """Add the terms of target and source to each edge, and apply the silu."""
    edge = 0
    for i in range(len(first_edge) - 1):
        for _ in range(first_edge[i], first_edge[i + 1]):
            j = sources[edge]
            for c in range(hidden.shape[1]):
                ends = of_target[i, c] + of_source[j, c]
                hidden[edge, c] = silu(hidden[edge, c] + ends)
            edge += 1


@compiled_fastmath
def sum_messages(
    first_edge: Edges, shares: Channels, bias: Channels, messages: Rows, out: Rows
) -> None:
    """Finish the messages, and sum those to each target by their shares."""
    edge = 0
    for i in range(len(first_edge) - 1):
        for _ in range(first_edge[i], first_edge[i + 1]):
            share = shares[edge]
            for c in range(messages.shape[1]):
                message = silu(messages[edge, c] + bias[c])
                messages[edge, c] = message
                out[i, c] += share * message
            edge += 1


@compiled_fastmath
def sum_coord_updates(
    first_edge: Edges, shares: Channels, coord_weights: Channels, r: Rows, out: Rows
) -> None:
    """Sum the vectors `r` to each target, weighted by tanh of `coord_weights`."""
    for edge in range(len(coord_weights)):
        tanh = TWO * sigmoid(TWO * coord_weights[edge]) - ONE
        coord_weights[edge] = tanh * shares[edge]
    edge = 0
    for i in range(len(first_edge) - 1):
        for _ in range(first_edge[i], first_edge[i + 1]):
            for d in range(3):
                out[i, d] += coord_weights[edge] * r[edge, d]
            edge += 1


@compiled_fastmath
def write_edge_features(
    graph: GraphBatch, shear: bool, begin: int, end: int, workspace: EncoderWorkspace
) -> None:
    """Write |r|^2, n_i.n_j, n_i.r, n_j.r, s_i.r, s_j.r of edges, r = x_i - x_j."""
    x = workspace.x
    n = graph.normals
    s = workspace.shear
    r = workspace.r
    edge = workspace.edge_features
    first = workspace.first_edge[begin]
    for target in range(begin, end):
        i = workspace.nodes[target]
        for e in range(workspace.first_edge[target], workspace.first_edge[target + 1]):
            j = workspace.sources[e]
            k = e - first
            r0 = x[i, 0] - x[j, 0]
            r1 = x[i, 1] - x[j, 1]
            r2 = x[i, 2] - x[j, 2]
            r[k, 0] = r0
            r[k, 1] = r1
            r[k, 2] = r2
            edge[k, 0] = r0 * r0 + r1 * r1 + r2 * r2
            edge[k, 1] = n[i, 0] * n[j, 0] + n[i, 1] * n[j, 1] + n[i, 2] * n[j, 2]
            edge[k, 2] = n[i, 0] * r0 + n[i, 1] * r1 + n[i, 2] * r2
            edge[k, 3] = n[j, 0] * r0 + n[j, 1] * r1 + n[j, 2] * r2
            if shear:
                edge[k, 4] = s[i, 0] * r0 + s[i, 1] * r1 + s[i, 2] * r2
                edge[k, 5] = s[j, 0] * r0 + s[j, 1] * r1 + s[j, 2] * r2
            else:
                edge[k, 4] = ZERO
                edge[k, 5] = ZERO


@compiled_fastmath
def pool_nodes(
    graph: GraphBatch,
    targets: int,
    weights: EncoderWeights,
    workspace: EncoderWorkspace,
    out: Channels,
) -> None:
    """Write the normalised maximum and force-weighted mean over the active nodes."""
    v = workspace.v
    pooled = workspace.pooled
    width = v.shape[1]
    largest = pooled[0, :width]
    mean = pooled[0, width:]
    for c in range(width):
        largest[c] = v[0, c]
        mean[c] = ZERO
    force = ZERO
    for i in range(targets):
        node = workspace.nodes[i]
        weight = graph.pressure[node] * graph.areas[node]
        force += weight
        for c in range(width):
            largest[c] = max(largest[c], v[i, c])
            mean[c] += weight * v[i, c]
    for c in range(width):
        mean[c] /= max(force, np.float32(1e-6))
    layer_norm(
        pooled, weights.pool_weight, weights.pool_bias, out.reshape(1, 2 * width)
    )


@compiled_fastmath
def arcsinh(x: float) -> float:
    """Return the inverse of sinh; numpy's own is several times slower for scalars."""
    size = abs(x)
    return math.copysign(math.log(size + math.sqrt(size * size + 1.0)), x)


@compiled_fastmath
def squared_norm(vector: Float[np.ndarray, "3"]) -> float:
    """Return the squared norm of a vector."""
    return vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]
