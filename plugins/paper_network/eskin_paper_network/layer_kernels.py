"""Compiled kernels of the paper's layer (its equation 2), forward and backward.

Edges are stored by target: those of target i are `first[i]` to `first[i + 1]`, each
with the row of its source. Blocks of edges are small enough to stay in the cache; their
products of matrices go through BLAS. The backward pass computes a block again instead
of reading it from memory, and skips targets without a gradient, which are nearly all
below a maximum over nodes.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import compiled, compiled_fastmath
from eskin.live.encoder_kernels import sigmoid

BLOCK = 256
"""Edges computed at once, few enough for BLAS to use one thread."""

ZERO = np.float32(0.0)
ONE = np.float32(1.0)
TWO = np.float32(2.0)

Rows = Float[np.ndarray, "row channel"]
Points = Float[np.ndarray, "row 3"]


class EdgeWeights(NamedTuple):
    """Holds the parameters of a layer's messages; matrices are (input, output)."""

    of_edge: Float[np.ndarray, "2 channel"]
    """Weights of |x_i - x_j|^2 and e_ij in the first layer of phi_e."""
    message: Float[np.ndarray, "channel channel"]
    """Weights of the second layer of phi_e."""
    message_bias: Float[np.ndarray, "channel"]
    """Its bias."""
    move: Float[np.ndarray, "channel channel"]
    """Weights of the first layer of phi_x."""
    move_bias: Float[np.ndarray, "channel"]
    """Its bias."""
    move_out: Float[np.ndarray, "channel"]
    """Weights of the second layer of phi_x."""


class EdgeInputs(NamedTuple):
    """Holds what messages are computed from. Targets are the first rows."""

    of_target: Float[np.ndarray, "target channel"]
    """Contribution of v_i to the first layer of phi_e."""
    of_source: Float[np.ndarray, "row channel"]
    """Contribution of v_j."""
    x: Float[np.ndarray, "row 3"]
    """Coordinates."""
    first: Int[np.ndarray, "target+1"]
    """First edge of each target."""
    source: Int[np.ndarray, "edge"]
    """Row of the source of each edge."""
    length: Float[np.ndarray, "edge"]
    """Kinematic distance e_ij of each edge."""


class EdgeBlock(NamedTuple):
    """Holds intermediate results for a block of edges."""

    target: Int[np.ndarray, "edge"]
    """Target of each edge."""
    source: Int[np.ndarray, "edge"]
    """Row of its source."""
    r: Float[np.ndarray, "edge 3"]
    """Vector from source to target, x_i - x_j."""
    squared: Float[np.ndarray, "edge"]
    """Its squared length."""
    length: Float[np.ndarray, "edge"]
    """Kinematic distance e_ij."""
    before_hidden: Float[np.ndarray, "edge channel"]
    """First layer of phi_e before its activation."""
    hidden: Float[np.ndarray, "edge channel"]
    """First layer of phi_e."""
    before_message: Float[np.ndarray, "edge channel"]
    """Second layer before its activation."""
    message: Float[np.ndarray, "edge channel"]
    """Message m_ij."""
    before_move: Float[np.ndarray, "edge channel"]
    """First layer of phi_x before its activation."""
    moving: Float[np.ndarray, "edge channel"]
    """First layer of phi_x."""
    weight: Float[np.ndarray, "edge"]
    """phi_x(m_ij)."""


@compiled
def allocate_block(edges: int, width: int) -> EdgeBlock:
    """Allocate memory for a block of edges."""
    return EdgeBlock(
        np.empty(edges, np.int32),
        np.empty(edges, np.int32),
        np.empty((edges, 3), np.float32),
        np.empty(edges, np.float32),
        np.empty(edges, np.float32),
        np.empty((edges, width), np.float32),
        np.empty((edges, width), np.float32),
        np.empty((edges, width), np.float32),
        np.empty((edges, width), np.float32),
        np.empty((edges, width), np.float32),
        np.empty((edges, width), np.float32),
        np.empty(edges, np.float32),
    )


@compiled
def find_block_size(first: Int[np.ndarray, "target+1"]) -> int:
    """Return a number of edges that is at least `BLOCK` and that of each target."""
    most = BLOCK
    for target in range(len(first) - 1):
        most = max(most, first[target + 1] - first[target])
    return most


@compiled_fastmath
def add_edges(inputs: EdgeInputs, target: int, count: int, block: EdgeBlock) -> int:
    """Add the edges of a target to a block of `count`; return the new count."""
    for edge in range(inputs.first[target], inputs.first[target + 1]):
        source = inputs.source[edge]
        squared = ZERO
        for axis in range(3):
            r = inputs.x[target, axis] - inputs.x[source, axis]
            block.r[count, axis] = r
            squared += r * r
        block.target[count] = target
        block.source[count] = source
        block.squared[count] = squared
        block.length[count] = inputs.length[edge]
        count += 1
    return count


@compiled_fastmath
def activate(x: Rows, bias: Float[np.ndarray, "channel"], out: Rows) -> None:
    """Add a bias to `x`, and write silu of the sum to `out`."""
    for i in range(x.shape[0]):
        for c in range(x.shape[1]):
            value = x[i, c] + bias[c]
            x[i, c] = value
            out[i, c] = value * sigmoid(value)


@compiled_fastmath
def compute_messages(
    inputs: EdgeInputs, weights: EdgeWeights, block: EdgeBlock, count: int, moves: bool
) -> None:
    """Compute the messages of a block, and phi_x of them where the layer moves x."""
    width = inputs.of_source.shape[1]
    for edge in range(count):
        target = block.target[edge]
        source = block.source[edge]
        squared = block.squared[edge]
        length = block.length[edge]
        for c in range(width):
            value = inputs.of_target[target, c] + inputs.of_source[source, c]
            value += squared * weights.of_edge[0, c] + length * weights.of_edge[1, c]
            block.before_hidden[edge, c] = value
            block.hidden[edge, c] = value * sigmoid(value)
    np.dot(block.hidden[:count], weights.message, block.before_message[:count])
    activate(block.before_message[:count], weights.message_bias, block.message[:count])
    if not moves:
        return
    np.dot(block.message[:count], weights.move, block.before_move[:count])
    activate(block.before_move[:count], weights.move_bias, block.moving[:count])
    for edge in range(count):
        weight = ZERO
        for c in range(width):
            weight += block.moving[edge, c] * weights.move_out[c]
        block.weight[edge] = weight


@compiled_fastmath
def sum_block(
    block: EdgeBlock, count: int, moves: bool, messages: Rows, steps: Points
) -> None:
    """Add the messages of a block, and what they move, to those of the targets."""
    for edge in range(count):
        target = block.target[edge]
        for c in range(messages.shape[1]):
            messages[target, c] += block.message[edge, c]
        if moves:
            for axis in range(3):
                steps[target, axis] += block.r[edge, axis] * block.weight[edge]


@compiled_fastmath
def sum_messages(
    inputs: EdgeInputs,
    weights: EdgeWeights,
    moves: bool,
    messages: Rows,
    steps: Points,
) -> None:
    """Compute equation 2's sums over j of m_ij, and of (x_i - x_j) phi_x(m_ij).

    Args:
        inputs: rows and edges.
        weights: parameters of the layer.
        moves: whether the coordinates are moved.
        messages: sums of messages, written; zero before.
        steps: sums of moves, written; zero before.
    """
    size = find_block_size(inputs.first)
    block = allocate_block(size, inputs.of_source.shape[1])
    count = 0
    for target in range(len(inputs.first) - 1):
        if count + inputs.first[target + 1] - inputs.first[target] > size:
            compute_messages(inputs, weights, block, count, moves)
            sum_block(block, count, moves, messages, steps)
            count = 0
        count = add_edges(inputs, target, count, block)
    compute_messages(inputs, weights, block, count, moves)
    sum_block(block, count, moves, messages, steps)


class EdgeGradients(NamedTuple):
    """Holds gradients of `EdgeInputs` and `EdgeWeights`, added to by each block."""

    of_target: Float[np.ndarray, "target channel"]
    of_source: Float[np.ndarray, "row channel"]
    x: Float[np.ndarray, "row 3"]
    of_edge: Float[np.ndarray, "2 channel"]
    message: Float[np.ndarray, "channel channel"]
    message_bias: Float[np.ndarray, "channel"]
    move: Float[np.ndarray, "channel channel"]
    move_bias: Float[np.ndarray, "channel"]
    move_out: Float[np.ndarray, "channel"]


@compiled_fastmath
def multiply_by_slope(x: Rows, gradient: Rows) -> None:
    """Multiply a gradient by the derivative of silu at `x`."""
    for i in range(x.shape[0]):
        for c in range(x.shape[1]):
            share = sigmoid(x[i, c])
            gradient[i, c] *= share * (ONE + x[i, c] * (ONE - share))


@compiled_fastmath
def add_columns(x: Rows, out: Float[np.ndarray, "channel"]) -> None:
    """Add the sums of columns to `out`."""
    for i in range(x.shape[0]):
        for c in range(x.shape[1]):
            out[c] += x[i, c]


@compiled_fastmath
def add_matrix(x: Rows, out: Rows) -> None:
    """Add a matrix to `out`."""
    for i in range(x.shape[0]):
        for c in range(x.shape[1]):
            out[i, c] += x[i, c]


@compiled_fastmath
def return_block(
    weights: EdgeWeights,
    block: EdgeBlock,
    count: int,
    moves: bool,
    of_messages: Rows,
    of_steps: Points,
    work: Rows,
    product: Rows,
    found: EdgeGradients,
) -> None:
    """Add a block's part of all gradients, after `compute_messages`.

    Args:
        weights: parameters of the layer.
        block: the block; its messages are overwritten.
        count: number of its edges.
        moves: whether the coordinates are moved.
        of_messages: gradient of the sums of messages.
        of_steps: gradient of the sums of moves.
        work: memory of a row for each edge.
        product: memory of a square matrix.
        found: gradients, added to.
    """
    width = work.shape[1]
    gradient = block.moving[:count] if moves else work[:count]
    rows = work[:count]
    if moves:
        for edge in range(count):
            target = block.target[edge]
            of_weight = ZERO
            for axis in range(3):
                of_weight += of_steps[target, axis] * block.r[edge, axis]
            for c in range(width):
                found.move_out[c] += block.moving[edge, c] * of_weight
                gradient[edge, c] = of_weight * weights.move_out[c]
        multiply_by_slope(block.before_move[:count], gradient)
        add_columns(gradient, found.move_bias)
        np.dot(block.message[:count].T, gradient, product)
        add_matrix(product, found.move)
        np.dot(gradient, weights.move.T, rows)
    else:
        rows[:] = ZERO
    for edge in range(count):
        target = block.target[edge]
        for c in range(width):
            rows[edge, c] += of_messages[target, c]
    multiply_by_slope(block.before_message[:count], rows)
    add_columns(rows, found.message_bias)
    np.dot(block.hidden[:count].T, rows, product)
    add_matrix(product, found.message)
    of_hidden = block.message[:count]
    np.dot(rows, weights.message.T, of_hidden)
    multiply_by_slope(block.before_hidden[:count], of_hidden)
    for edge in range(count):
        target = block.target[edge]
        source = block.source[edge]
        squared = block.squared[edge]
        length = block.length[edge]
        of_squared = ZERO
        for c in range(width):
            value = of_hidden[edge, c]
            found.of_target[target, c] += value
            found.of_source[source, c] += value
            found.of_edge[0, c] += value * squared
            found.of_edge[1, c] += value * length
            of_squared += value * weights.of_edge[0, c]
        for axis in range(3):
            of_r = TWO * of_squared * block.r[edge, axis]
            if moves:
                of_r += of_steps[target, axis] * block.weight[edge]
            found.x[target, axis] += of_r
            found.x[source, axis] -= of_r


@compiled_fastmath
def return_messages(
    inputs: EdgeInputs,
    weights: EdgeWeights,
    moves: bool,
    of_messages: Rows,
    of_steps: Points,
    asked: Bool[np.ndarray, "target"],
    found: EdgeGradients,
) -> None:
    """Add the gradients of `sum_messages` to `found`.

    Args:
        inputs: rows and edges.
        weights: parameters of the layer.
        moves: whether the coordinates are moved.
        of_messages: gradient of the sums of messages.
        of_steps: gradient of the sums of moves.
        asked: targets that have a gradient.
        found: gradients, added to.
    """
    width = inputs.of_source.shape[1]
    size = find_block_size(inputs.first)
    block = allocate_block(size, width)
    work = np.empty((size, width), np.float32)
    product = np.empty((width, width), np.float32)
    count = 0
    last = len(inputs.first) - 1
    for target in range(last + 1):
        ends = target == last
        if not ends and not asked[target]:
            continue
        more = 0 if ends else inputs.first[target + 1] - inputs.first[target]
        if ends or count + more > size:
            compute_messages(inputs, weights, block, count, moves)
            return_block(
                weights,
                block,
                count,
                moves,
                of_messages,
                of_steps,
                work,
                product,
                found,
            )
            count = 0
        if not ends:
            count = add_edges(inputs, target, count, block)


@compiled
def mark_changed(
    touched: Bool[np.ndarray, "reading taxel"],
    table: Int[np.ndarray, "taxel k"],
    live: Int[np.ndarray, "reading taxel live"],
    hops: int,
    hop: Int[np.ndarray, "reading taxel"],
) -> None:
    """Write after how many layers each node differs from rest, `hops + 1` if never.

    A node differs after a layer if it is touched, has a live edge, or has a source that
    differed before the layer.
    """
    readings, taxels = touched.shape
    for reading in range(readings):
        for node in range(taxels):
            hop[reading, node] = hops + 1
            if touched[reading, node] or (
                live.shape[2] and live[reading, node, 0] >= 0
            ):
                hop[reading, node] = 1
        for layer in range(1, hops + 1):
            for node in range(taxels):
                if hop[reading, node] <= layer:
                    continue
                for neighbour in table[node]:
                    if neighbour < 0:
                        continue
                    if layer == 1 and touched[reading, neighbour]:
                        hop[reading, node] = 1
                        break
                    if layer > 1 and hop[reading, neighbour] < layer:
                        hop[reading, node] = layer
                        break


@compiled
def count_edges(
    target: Int[np.ndarray, "target"],
    reading: Int[np.ndarray, "target"],
    table: Int[np.ndarray, "taxel k"],
    live: Int[np.ndarray, "reading taxel live"],
    first: Int[np.ndarray, "target+1"],
) -> None:
    """Write the first edge of each target."""
    first[0] = 0
    for i in range(len(target)):
        count = 0
        for neighbour in table[target[i]]:
            count += neighbour >= 0
        for neighbour in live[reading[i], target[i]]:
            count += neighbour >= 0
        first[i + 1] = first[i] + count


@compiled
def list_edges(
    target: Int[np.ndarray, "target"],
    reading: Int[np.ndarray, "target"],
    table: Int[np.ndarray, "taxel k"],
    live: Int[np.ndarray, "reading taxel live"],
    place: Int[np.ndarray, "reading taxel"],
    nodes: Int[np.ndarray, "most"],
    readings: Int[np.ndarray, "most"],
    source: Int[np.ndarray, "edge"],
) -> int:
    """Write the source row of each edge; return the number of rows.

    Args:
        target: taxel of each target, whose rows come first.
        reading: its reading.
        table: fixed neighbours of each taxel, -1 at the end.
        live: live neighbours of each taxel in each reading.
        place: row of each node of each reading, -1 where it has none; written.
        nodes: taxel of each row, written.
        readings: reading of each row, written.
        source: rows of the sources, written.
    """
    rows = len(target)
    edge = 0
    for i in range(len(target)):
        for part in range(2):
            near = table[target[i]] if part == 0 else live[reading[i], target[i]]
            for neighbour in near:
                if neighbour < 0:
                    continue
                row = place[reading[i], neighbour]
                if row < 0:
                    row = rows
                    place[reading[i], neighbour] = row
                    nodes[row] = neighbour
                    readings[row] = reading[i]
                    rows += 1
                source[edge] = row
                edge += 1
    return rows


@compiled
def find_largest(
    computed: Rows,
    reading: Int[np.ndarray, "target"],
    node: Int[np.ndarray, "target"],
    rest: Rows,
    order: Int[np.ndarray, "taxel channel"],
    largest: Int[np.ndarray, "reading channel"],
) -> None:
    """Write where each channel of each reading is largest over all nodes.

    Args:
        computed: features of nodes that differ from rest.
        reading: reading of each of them.
        node: its taxel.
        rest: features of all nodes at rest.
        order: taxels by their features at rest, the largest first.
        largest: row of `computed`, or the number of these plus the taxel at rest;
            written.
    """
    readings, width = largest.shape
    differs = np.zeros((readings, len(rest)), np.bool_)
    largest[:] = -1
    for row in range(len(computed)):
        differs[reading[row], node[row]] = True
        for c in range(width):
            best = largest[reading[row], c]
            if best < 0 or computed[row, c] > computed[best, c]:
                largest[reading[row], c] = row
    for i in range(readings):
        for c in range(width):
            for taxel in order[:, c]:
                if not differs[i, taxel]:
                    best = largest[i, c]
                    if best < 0 or rest[taxel, c] > computed[best, c]:
                        largest[i, c] = len(computed) + taxel
                    break
