"""Compare a step of the engine with the arithmetic limit of this machine.

    python -m lab.limit

The arithmetic of a step with 60 active taxels follows from the sizes of the network and
the edges of the graph. Matrix products of the same shapes are timed with BLAS alone,
and the ratio of the step to them is printed. The bytes are weights, nodes, edges and
windows, each read or written once.
"""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import tyro

from eskin.live import (
    NODE_SCALARS,
    FixedNeighbours,
    GraphConfig,
    Model,
    find_live_neighbours,
    load_model,
)
from eskin.robot import load_robot
from eskin.sim.bench.latency import TimedEngine, pin_to_one_core
from eskin.sim.bench.scene import (
    BenchScene,
    find_forearm_taxels,
    large_skin,
)
from eskin.skin import MountedSkin

FLOAT = 4
"""Size of a number [bytes]."""

EDGE_SCALARS = 6


@dataclass(frozen=True)
class Command:
    """Compare a step with products of the same shapes."""

    active: int = 60
    """Active taxels."""
    steps: int = 5000
    """Steps timed."""


@dataclass(frozen=True)
class Product:
    """Describes a product of rows with a matrix of weights, and its number per step."""

    name: str
    rows: int
    inputs: int
    outputs: int
    times: int = 1

    @property
    def operations(self) -> int:
        """Number of multiplications and additions."""
        return 2 * self.rows * self.inputs * self.outputs * self.times

    @property
    def bytes(self) -> int:
        """Number of bytes of the matrix, of its inputs and of its outputs."""
        rows = self.rows * (self.inputs + self.outputs)
        return FLOAT * self.times * (rows + self.inputs * self.outputs)


def main() -> None:
    """Count, time and print."""
    command = tyro.cli(Command)
    mounted = MountedSkin(large_skin(2112), load_robot("ur5"))
    nodes, edges = count_graph(mounted, command.active)
    products = list_products(load_model("ur5"), command.active, nodes, edges)
    with pin_to_one_core():
        scene = BenchScene(mounted, find_forearm_taxels(mounted.skin, command.active))
        subject = TimedEngine("eskin", mounted, scene)
        wanted = subject.steps(command.steps)
        alone, taken = [], []
        for _ in range(10):
            taken += subject.run(wanted // 10)
            alone.append([time_product(product) for product in products])
        moved = sum(product.bytes for product in products)
        copied = measure_copy_rate(moved)
    plain = np.median(alone, axis=0)
    print(f"{command.active} active taxels, {nodes} nodes, {edges} edges\n")
    print("| product | rows | shape | times | kFLOP | plain [us] | GFLOP/s |")
    print("|---|---|---|---|---|---|---|")
    for product, seconds in zip(products, plain, strict=True):
        shape = f"{product.inputs} x {product.outputs} | {product.times}"
        rate = product.operations / seconds * 1e-9
        print(
            f"| {product.name} | {product.rows} | {shape} | "
            f"{product.operations * 1e-3:.0f} | {1e6 * seconds:.1f} | {rate:.1f} |"
        )
    operations = sum(product.operations for product in products)
    step = float(np.median(taken))
    print(
        f"\n{operations * 1e-6:.2f} MFLOP and {moved * 1e-6:.2f} MB a step; plain "
        f"products take {1e6 * plain.sum():.0f} us "
        f"({operations / plain.sum() * 1e-9:.1f} GFLOP/s), moving the bytes "
        f"{1e6 * moved / copied:.0f} us ({copied * 1e-9:.1f} GB/s); the step takes "
        f"{1e6 * step:.0f} us: {step / plain.sum():.1f} x the products"
    )


def count_graph(mounted: MountedSkin, active: int) -> tuple[int, int]:
    """Return the numbers of nodes and of edges to active nodes in a contact's graph."""
    skin, config = mounted.skin, GraphConfig()
    fixed, taxels = (
        FixedNeighbours(skin, config.fixed),
        find_forearm_taxels(skin, active),
    )
    senders = fixed.table[taxels]
    nodes = np.union1d(taxels, senders[senders >= 0])
    p_world, _ = mounted.place_taxels(np.zeros(len(mounted.robot.joint_names)), nodes)
    patches, rank = skin.patch_index[nodes], fixed.rank[nodes]
    live = find_live_neighbours(p_world, patches, rank, config.live, config.live_reach)
    receives = np.isin(nodes, taxels)
    return len(nodes), int((senders >= 0).sum() + (live[receives] >= 0).sum())


def list_products(
    model: Model, active: int, nodes: int, edges: int
) -> Sequence[Product]:
    """List every product of a step; the first linear map of a layer runs once a node.

    Args:
        model: model with the weights.
        active: number of nodes that receive messages.
        nodes: number of nodes of the graph.
        edges: number of edges of the graph.
    """
    width, layers = model.card.network.width, model.card.network.layers
    products = [
        Product("embed", nodes, len(NODE_SCALARS), width),
        Product("of target", active, width, width, layers),
        Product("of source", nodes, width, width, layers),
        Product("of edge", edges, EDGE_SCALARS, width, layers),
        Product("message", edges, width, width, layers),
        Product("move", edges, width, 1, layers - 1),
        Product("update, hidden", active, 2 * width, width, layers),
        Product("update, out", active, width, width, layers),
    ]
    for head in ("summary_head", "graph_head"):
        for part in ("project", "short.conv", "long.conv", "classify"):
            outputs, *inputs = model.weights[f"{head}.{part}.weight"].shape
            size = int(np.prod(inputs))
            products.append(Product(f"{head}, {part}", 1, size, outputs))
    return products


def time_product(product: Product) -> float:
    """Return the median time of a product in BLAS [s]."""
    rng = np.random.default_rng(0)
    rows = rng.random((product.rows, product.inputs), np.float32)
    weights = rng.random((product.inputs, product.outputs), np.float32)
    out = np.empty((product.rows, product.outputs), np.float32)
    return product.times * time_call(lambda: np.dot(rows, weights, out=out))


def measure_copy_rate(size: int) -> float:
    """Return the rate of reading and writing while copying some bytes [B/s]."""
    source = np.ones(size // (2 * FLOAT), np.float32)
    target = np.empty_like(source)
    return 2 * source.nbytes / time_call(lambda: np.copyto(target, source))


def time_call(call: Callable[[], object], times: int = 200) -> float:
    """Return the median time of a call [s]."""
    found = []
    for _ in range(times):
        start = time.perf_counter()
        call()
        found.append(time.perf_counter() - start)
    return float(np.median(found))


if __name__ == "__main__":
    main()
