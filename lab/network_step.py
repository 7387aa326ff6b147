"""Time each part of the compiled network at one reading.

    python -m lab.network_step

A hand presses some taxels on the forearm of the ur5 skin. The last column is the ratio
to torch on the same graph and window in the same run, because machines differ and are
shared.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import count

import numpy as np
import torch
import tyro

import eskin
from eskin.learn.checkpoint import to_model
from eskin.learn.nn import (
    RecogniserNetwork,
    SlotIndex,
    build_graph_tensors,
)
from eskin.live import (
    NO_HISTORY,
    SLOT_NS,
    GraphBatch,
    GraphBuilder,
    GraphConfig,
    Model,
    ModelCard,
    NetworkConfig,
    TouchNodes,
    pack_touch_nodes,
)
from eskin.live.encoder_kernels import encode
from eskin.live.network import LogitStream, Network
from eskin.live.summary_kernels import summarise
from lab.live_parts import SequenceWindow, compute_features

VOCABULARY = ("none", "poke", "double_pat", "grab", "stroke")
ACTIVE = (1, 20, 60, 83)
FULL = 100
"""Number of readings that fill a window."""


@dataclass(frozen=True)
class Command:
    """Time the network, part by part."""

    steps: int = 500
    """Number of readings timed in each row."""
    width: int = 32
    """Channels of a node; 0 without a graph view."""
    layers: int = 3
    """Equivariant layers."""
    channels: int = 48
    """Channels of each temporal head."""


def main() -> None:
    """Time the parts and print a table."""
    command = tyro.cli(Command)
    torch.manual_seed(0)
    torch.set_num_threads(1)
    config = NetworkConfig(
        width=command.width,
        layers=command.layers,
        channels=command.channels,
    )
    network = RecogniserNetwork(config, len(VOCABULARY), shear=False).eval()
    model = to_model(network, ModelCard(VOCABULARY, network=config))
    titles = (
        "active",
        "nodes",
        "graph",
        "encoder",
        "summary",
        "heads",
        "step",
        "torch / step",
    )
    print("p50 / p99 [ms]\n")
    print(f"| {' | '.join(titles)} |")
    print(f"|{'---|' * len(titles)}")
    for active in ACTIVE:
        builder, nodes, reading = build_pressed_graph(active)
        batch = builder.build(*nodes)
        later = (
            replace(reading, stamp=reading.stamp + SLOT_NS * (n + 1))
            for n in range(FULL + command.steps)
        )
        calls = list_compiled_parts(model, builder, nodes, list(later))
        parts = [time_calls(call, command.steps) for call in calls]
        slow = time_calls(build_torch_step(network, batch), command.steps // 5)
        cells = [f"{np.median(t):.4f} / {np.percentile(t, 99):.4f}" for t in parts]
        ratio = f"{np.median(slow) / np.median(parts[-1]):.0f} x"
        row = [str(active), str(len(batch.taxels)), *cells, ratio]
        print(f"| {' | '.join(row)} |")


def build_pressed_graph(active: int) -> tuple[GraphBuilder, TouchNodes, eskin.Reading]:
    """Build the inputs of the graph of a hand that presses some taxels.

    Returns:
        The graph builder, the touch nodes and the last reading, at rising load.
    """
    skin = eskin.load_skin("ur5")
    mounted = eskin.MountedSkin(skin, eskin.load_robot("ur5"))
    patch = skin.find_taxels("forearm_front")
    centre = skin.positions[patch].mean(axis=0)
    distance = np.linalg.norm(skin.positions[patch] - centre, axis=1)
    taxels = np.sort(patch[np.argsort(distance)[:active]])
    touched = np.zeros(skin.count, dtype=bool)
    touched[taxels] = True
    builder = GraphBuilder(mounted, GraphConfig())
    readings = []
    for n in range(2):
        pressure = np.where(touched, 20.0 + n, 0.0).astype(np.float32)
        valid, q = np.ones(skin.count, dtype=bool), np.zeros(6)
        readings.append(eskin.Reading(SLOT_NS * (n + 1), pressure, valid, q))
        builder.advance(readings[-1], taxels)
    return builder, TouchNodes(taxels, taxels, NO_HISTORY), readings[-1]


def list_compiled_parts(
    model: Model, builder: GraphBuilder, nodes: TouchNodes, later: list[eskin.Reading]
) -> list[Callable[[], object]]:
    """List calls of graph, encoder, summary, heads and whole step for one reading."""
    network, stream = Network(model), LogitStream(model, builder)
    graph = builder.build(*nodes)
    window = SequenceWindow(network.heads, network.slots)
    weights, memory = network.weights, network.workspace
    encoder = weights.encoder
    embedding = np.zeros(2 * network.width, np.float32)
    summary = np.zeros(len(weights.summary_mean), np.float32)
    features = compute_features(network, graph).copy()
    stamps, readings = count(SLOT_NS, SLOT_NS), iter(later)
    packed = pack_touch_nodes({1: nodes})
    return [
        lambda: builder.build(*nodes),
        lambda: network.width and encode(graph, False, encoder, memory, embedding),
        lambda: summarise(graph, 0, False, summary),
        lambda: window.push(next(stamps), features),
        lambda: stream.push(next(readings), packed),
    ]


def build_torch_step(
    network: RecogniserNetwork, batch: GraphBatch
) -> Callable[[], object]:
    """Build the same step in torch: embed one graph, and classify a full window."""
    slots = network.config.slots
    places = SlotIndex(torch.zeros(slots, dtype=torch.long), torch.arange(slots), 1)

    def step() -> None:
        with torch.no_grad():
            features = network.embed(build_graph_tensors(batch, shear=False))
            network.classify(features.expand(slots, -1), places)

    return step


def time_calls(call: Callable[[], object], steps: int) -> np.ndarray:
    """Return the duration of each call, after as many as fill a window [ms]."""
    found = []
    for _ in range(FULL + steps):
        start = time.perf_counter()
        call()
        found.append(time.perf_counter() - start)
    return 1e3 * np.array(found[FULL:])


if __name__ == "__main__":
    main()
