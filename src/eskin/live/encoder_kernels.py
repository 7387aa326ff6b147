"""The compiled encoder: what `eskin.nn.Encoder` does, for one graph.

Products of matrices go through BLAS, everything else is loops along channels.
"""

import math
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int

from eskin.graph.features import LONGEST_AGE
from eskin.live.encoder import EncoderMemory, EncoderWeights
from eskin.live.graph import Graph
from eskin.live.kernels import (
    BLOCK,
    activate,
    add,
    add_bias,
    compiled_network,
    normalise,
    product,
    sigmoid,
    silu,
)
from eskin.model import LENGTH_CM

PER_LENGTH = np.float32(1.0 / LENGTH_CM)
NOBODY = -1
ONE, TWO = np.float32(1.0), np.float32(2.0)


@compiled_network
@no_type_check
def encode(
    graph: Graph,
    shear: bool,
    weights: EncoderWeights,
    memory: EncoderMemory,
    out: Float[np.ndarray, "embedding"],
) -> None:
    """Write the embedding of a graph; zeros where nothing is active.

    Args:
        graph: the graph.
        shear: whether the network takes shear; else it is left out.
        weights: of the network.
        memory: with room for the graph.
        out: where the embedding goes.
    """
    targets = find_targets(graph, memory)
    if targets == 0:
        out[:] = np.float32(0.0)
        return
    edges = find_edges(graph, targets, memory)
    place(graph, shear, memory)
    rows = embed(graph, targets, edges, weights, memory)
    for layer in range(len(weights.message_weight)):
        step(layer, graph, shear, targets, rows, weights, memory)
    pool(graph, targets, weights, memory, out)


@compiled_network
@no_type_check
def find_targets(graph: Graph, memory: EncoderMemory) -> int:
    """Number the active nodes, the targets, and return how many there are."""
    targets = 0
    for node in range(graph.nodes):
        memory.row[node] = NOBODY
        if graph.pressure[node] > 0.0:
            memory.row[node] = targets
            memory.nodes[targets] = node
            targets += 1
    return targets


@compiled_network
@no_type_check
def find_edges(graph: Graph, targets: int, memory: EncoderMemory) -> int:
    """List who is heard by each target, and return how many edges there are."""
    sources, shares = memory.sources, memory.shares
    edges = 0
    for i in range(targets):
        node = memory.nodes[i]
        memory.firsts[i] = edges
        heard = np.float32(0.0)
        for k in range(graph.neighbours.shape[1]):
            source = graph.neighbours[node, k]
            if source >= 0:
                sources[edges] = source
                shares[edges] = graph.areas[source]
                heard += graph.areas[source]
                edges += 1
        for e in range(memory.firsts[i], edges):
            shares[e] /= max(heard, np.float32(1e-6))
    memory.firsts[targets] = edges
    return edges


@compiled_network
@no_type_check
def place(graph: Graph, shear: bool, memory: EncoderMemory) -> None:
    """Write coordinates and, where the network takes it, compressed shear."""
    for node in range(graph.nodes):
        for d in range(3):
            memory.x[node, d] = graph.positions[node, d] * PER_LENGTH
        if shear:
            size = math.sqrt(squared(graph.shear[node]))
            scale = np.float32(arcsinh(size) / (3.0 * max(size, 1e-9)))
            for d in range(3):
                memory.shear[node, d] = graph.shear[node, d] * scale


@compiled_network
@no_type_check
def embed(
    graph: Graph,
    targets: int,
    edges: int,
    weights: EncoderWeights,
    memory: EncoderMemory,
) -> int:
    """Write the first features of every row, and return how many rows there are."""
    for i in range(targets):
        describe(graph, memory.nodes[i], i, memory)
    rows, rest = targets, NOBODY
    for e in range(edges):
        node = memory.sources[e]
        if memory.row[node] == NOBODY:
            at_rest = describe(graph, node, rows, memory)
            if at_rest and rest != NOBODY:
                memory.row[node] = rest
            else:
                memory.row[node] = rows
                rest = rows if at_rest else rest
                rows += 1
        memory.source_rows[e] = memory.row[node]
    product(memory.scalars[:rows], weights.embed_weight, memory.v[:rows])
    activate(memory.v[:rows], weights.embed_bias)
    return rows


@compiled_network
@no_type_check
def describe(graph: Graph, node: int, row: int, memory: EncoderMemory) -> bool:
    """Write the scalars of a node to a row, and tell whether all are zero."""
    scalars = memory.scalars
    p, before = graph.pressure[node], graph.before[node]
    s = squared(memory.shear[node])
    if p == 0.0 and before == 0.0 and s == 0.0 and graph.age[node] == 0.0:
        scalars[row] = np.float32(0.0)
        return True
    rate = (p - before) / graph.seconds
    scalars[row, 0] = p > 0.0
    scalars[row, 1] = arcsinh(p / 2.0) / 3.0
    scalars[row, 2] = arcsinh(rate / 50.0) / 2.0
    scalars[row, 3] = min(graph.age[node], LONGEST_AGE) / LONGEST_AGE
    scalars[row, 4] = math.sqrt(s)
    return False


@compiled_network
@no_type_check
def step(
    layer: int,
    graph: Graph,
    shear: bool,
    targets: int,
    rows: int,
    weights: EncoderWeights,
    memory: EncoderMemory,
) -> None:
    """One step of `eskin.nn.EquivariantLayer`."""
    u = memory.u[:rows]
    of_target, heard = memory.of_target[:targets], memory.heard[:targets]
    width = u.shape[1]
    normalise(memory.v[:rows], weights.norm_weight[layer], weights.norm_bias[layer], u)
    product(u, weights.of_source_weight[layer], memory.of_source[:rows])
    product(u[:targets], weights.of_target_weight[layer], of_target)
    add_bias(of_target, weights.of_target_bias[layer])
    memory.moved[:targets] = np.float32(0.0)
    heard[:] = np.float32(0.0)
    hear(layer, graph, shear, targets, weights, memory)
    hidden = memory.of_source[:targets]
    product(u[:targets], weights.update_hidden_weight[layer, :width], hidden)
    product(heard, weights.update_hidden_weight[layer, width:], of_target)
    add(of_target, hidden)
    activate(hidden, weights.update_hidden_bias[layer])
    product(hidden, weights.update_out_weight[layer], of_target)
    add_bias(of_target, weights.update_out_bias[layer])
    add(of_target, memory.v[:targets])
    for i in range(targets):
        node = memory.nodes[i]
        for d in range(3):
            memory.x[node, d] += memory.moved[i, d]


@compiled_network
@no_type_check
def hear(
    layer: int,
    graph: Graph,
    shear: bool,
    targets: int,
    weights: EncoderWeights,
    memory: EncoderMemory,
) -> None:
    """Add up what every target hears, about a block of edges at a time."""
    begin = 0
    while begin < targets:
        end, first = begin + 1, memory.firsts[begin]
        while end < targets and memory.firsts[end + 1] - first <= BLOCK:
            end += 1
        hear_block(layer, graph, shear, begin, end, weights, memory)
        begin = end


@compiled_network
@no_type_check
def hear_block(
    layer: int,
    graph: Graph,
    shear: bool,
    begin: int,
    end: int,
    weights: EncoderWeights,
    memory: EncoderMemory,
) -> None:
    """Add up what the targets from `begin` to before `end` hear."""
    firsts = memory.firsts[begin : end + 1]
    edges = firsts[-1] - firsts[0]
    sources = memory.source_rows[firsts[0] : firsts[-1]]
    shares = memory.shares[firsts[0] : firsts[-1]]
    hidden, messages = memory.hidden[:edges], memory.messages[:edges]
    measure(graph, shear, begin, end, memory)
    np.dot(memory.edge[:edges], weights.of_edge_weight[layer], hidden)
    add_ends(firsts, sources, memory.of_target[begin:end], memory.of_source, hidden)
    np.dot(hidden, weights.message_weight[layer], messages)
    add_shares(
        firsts, shares, weights.message_bias[layer], messages, memory.heard[begin:end]
    )
    if layer + 1 < len(weights.message_weight):  # the last one moves nothing
        ways = memory.ways[:edges]
        np.dot(messages, weights.move_weight[layer], ways)
        add_moves(firsts, shares, ways, memory.r, memory.moved[begin:end])


@compiled_network
@no_type_check
def add_ends(
    firsts: Int[np.ndarray, "target_and_one"],
    sources: Int[np.ndarray, "edge"],
    of_target: Float[np.ndarray, "target width"],
    of_source: Float[np.ndarray, "row width"],
    hidden: Float[np.ndarray, "edge width"],
) -> None:
    """Add to each edge what its target and its source bring, and take the silu."""
    edge = 0
    for i in range(len(firsts) - 1):
        for _ in range(firsts[i], firsts[i + 1]):
            j = sources[edge]
            for c in range(hidden.shape[1]):
                ends = of_target[i, c] + of_source[j, c]
                hidden[edge, c] = silu(hidden[edge, c] + ends)
            edge += 1


@compiled_network
@no_type_check
def add_shares(
    firsts: Int[np.ndarray, "target_and_one"],
    shares: Float[np.ndarray, "edge"],
    bias: Float[np.ndarray, "width"],
    messages: Float[np.ndarray, "edge width"],
    heard: Float[np.ndarray, "target width"],
) -> None:
    """Finish the messages, and add up those to each target by their shares."""
    edge = 0
    for i in range(len(firsts) - 1):
        for _ in range(firsts[i], firsts[i + 1]):
            share = shares[edge]
            for c in range(messages.shape[1]):
                message = silu(messages[edge, c] + bias[c])
                messages[edge, c] = message
                heard[i, c] += share * message
            edge += 1


@compiled_network
@no_type_check
def add_moves(
    firsts: Int[np.ndarray, "target_and_one"],
    shares: Float[np.ndarray, "edge"],
    ways: Float[np.ndarray, "edge"],
    r: Float[np.ndarray, "edge 3"],
    moved: Float[np.ndarray, "target 3"],
) -> None:
    """Add up how far the messages, which say how much each `r` counts, move targets."""
    for edge in range(len(ways)):
        tanh = TWO * sigmoid(TWO * ways[edge]) - ONE
        ways[edge] = tanh * shares[edge]
    edge = 0
    for i in range(len(firsts) - 1):
        for _ in range(firsts[i], firsts[i + 1]):
            for d in range(3):
                moved[i, d] += ways[edge] * r[edge, d]
            edge += 1


@compiled_network
@no_type_check
def measure(
    graph: Graph, shear: bool, begin: int, end: int, memory: EncoderMemory
) -> None:
    """|r|^2, n_i.n_j, n_i.r, n_j.r, s_i.r, s_j.r of a block's edges; r = x_i - x_j."""
    x, n, s, r, edge = memory.x, graph.normals, memory.shear, memory.r, memory.edge
    first = memory.firsts[begin]
    for target in range(begin, end):
        i = memory.nodes[target]
        for e in range(memory.firsts[target], memory.firsts[target + 1]):
            j, k = memory.sources[e], e - first
            r0, r1, r2 = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1], x[i, 2] - x[j, 2]
            r[k, 0], r[k, 1], r[k, 2] = r0, r1, r2
            edge[k, 0] = r0 * r0 + r1 * r1 + r2 * r2
            edge[k, 1] = n[i, 0] * n[j, 0] + n[i, 1] * n[j, 1] + n[i, 2] * n[j, 2]
            edge[k, 2] = n[i, 0] * r0 + n[i, 1] * r1 + n[i, 2] * r2
            edge[k, 3] = n[j, 0] * r0 + n[j, 1] * r1 + n[j, 2] * r2
            if shear:
                edge[k, 4] = s[i, 0] * r0 + s[i, 1] * r1 + s[i, 2] * r2
                edge[k, 5] = s[j, 0] * r0 + s[j, 1] * r1 + s[j, 2] * r2
            else:
                edge[k, 4], edge[k, 5] = np.float32(0.0), np.float32(0.0)


@compiled_network
@no_type_check
def pool(
    graph: Graph,
    targets: int,
    weights: EncoderWeights,
    memory: EncoderMemory,
    out: Float[np.ndarray, "embedding"],
) -> None:
    """Largest and force-weighted mean feature of the active nodes, normalised."""
    v, pooled = memory.v, memory.pooled
    width = v.shape[1]
    largest, mean = pooled[0, :width], pooled[0, width:]
    largest[:] = v[0]
    mean[:] = np.float32(0.0)
    force = np.float32(0.0)
    for i in range(targets):
        node = memory.nodes[i]
        weight = graph.pressure[node] * graph.areas[node]
        force += weight
        for c in range(width):
            largest[c] = max(largest[c], v[i, c])
            mean[c] += weight * v[i, c]
    for c in range(width):
        mean[c] /= max(force, np.float32(1e-6))
    normalise(pooled, weights.pool_weight, weights.pool_bias, out.reshape(1, 2 * width))


@compiled_network
@no_type_check
def arcsinh(x: float) -> float:
    """The inverse of sinh; numpy's own is several times slower one at a time."""
    size = abs(x)
    return math.copysign(math.log(size + math.sqrt(size * size + 1.0)), x)


@compiled_network
@no_type_check
def squared(vector: Float[np.ndarray, "3"]) -> float:
    """Its length squared."""
    return vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]
