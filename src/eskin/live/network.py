"""This module runs the compiled network on a stream of readings.

It lays out a model's weights and working memory for compiled code.
"""

from collections.abc import Mapping
from functools import partial
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.compiled import Packed, pack
from eskin.live.encoder_kernels import BLOCK, EncoderWeights, EncoderWorkspace
from eskin.live.graph_builder import GraphBuilder, TouchNodes, join_active
from eskin.live.graph_features import NODE_SCALARS
from eskin.live.graph_kernels import GraphWorkspace
from eskin.live.head_kernels import (
    NO_SLOT,
    SCALES,
    STATISTICS,
    HeadState,
    HeadWeights,
)
from eskin.live.model_config import EDGE_SCALARS, NetworkConfig
from eskin.live.model_file import (
    CLOSING_LAYER,
    OPEN_LAYER,
    Model,
    check_weights,
    encoder_shapes,
    has_closing_layer,
    layer_shapes,
    prefix_names,
)
from eskin.live.step_kernels import (
    NetworkParts,
    StepParts,
    step,
    write_probabilities,
)
from eskin.touch import Reading

Weights = Mapping[str, np.ndarray]
"""Parameters by name, as in the state of the torch network."""

INITIAL_NODES = 256
INITIAL_NEIGHBOURS = 16
"""Size of the graphs that there is memory for at first."""

BRANCHES = ("summary", "graph")
"""Names of the heads, side by side in every array: the first takes the summary alone,
the second, which a network may lack, also the embedding."""

PerClass = Float[np.ndarray, "class"]


@final
class Network:
    """A network holds a model's weights and the memory in which compiled code works.

    It computes what the torch network does that was trained. Its memory serves one
    thread at a time.
    """

    def __init__(self, model: Model) -> None:
        """Lay out a model's weights.

        Raises:
            ModelError: naming the first parameter that does not fit the model's card.
        """
        weights = check_weights(model)
        card = model.card
        self.slots = card.network.slots
        self.width = card.network.width
        features = len(weights["summary_mean"]) + 2 * self.width
        self.parts = NetworkParts(
            shear=card.kind == "shear",
            summary_mean=weights["summary_mean"],
            summary_scale=weights["summary_scale"],
            encoder=build_encoder_weights(weights, card.network),
            heads=build_head_weights(weights),
            temperature=card.temperature,
            workspace=allocate_encoder(INITIAL_NODES, INITIAL_NEIGHBOURS, self.width),
            features=np.empty(features, np.float32),
        )

    def reserve(self, nodes: int, neighbours: int) -> NetworkParts:
        """Return the parts, with memory for twice a graph that did not fit before."""
        workspace = self.parts.workspace
        fits = nodes <= len(workspace.nodes) and neighbours <= len(workspace.hidden)
        if not fits or nodes * neighbours > len(workspace.sources):
            workspace = allocate_encoder(2 * nodes, neighbours, self.width)
            self.parts = self.parts._replace(workspace=workspace)
        return self.parts


def build_encoder_weights(weights: Weights, config: NetworkConfig) -> EncoderWeights:
    """Lay out the parameters whose names begin with `encoder.`.

    Without an encoder they are empty.
    """
    width = config.width
    layers = config.layers
    if not width:
        shapes = prefix_names("encoder", encoder_shapes(width, layers))
        weights = {k: np.zeros(shape, np.float32) for k, shape in shapes.items()}
    parts = {
        "embed_weight": weights["encoder.embed.weight"].T,
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


def allocate_encoder(nodes: int, neighbours: int, width: int) -> EncoderWorkspace:
    """Allocate memory for graphs of so many nodes with so many neighbours each."""
    real = partial(np.empty, dtype=np.float32)
    whole = partial(np.empty, dtype=np.int32)
    edges = nodes * neighbours
    block = max(BLOCK, neighbours)
    return EncoderWorkspace(
        x=real((nodes, 3)),
        shear=np.zeros((nodes, 3), np.float32),
        row=whole(nodes),
        nodes=whole(nodes),
        first_edge=whole(nodes + 1),
        sources=whole(edges),
        source_rows=whole(edges),
        edge_weights=real(edges),
        scalars=real((nodes, len(NODE_SCALARS))),
        v=real((nodes, width)),
        u=real((nodes, width)),
        of_source=real((nodes, width)),
        of_target=real((nodes, width)),
        messages=real((nodes, width)),
        coord_update=real((nodes, 3)),
        r=real((block, 3)),
        edge_features=real((block, EDGE_SCALARS)),
        hidden=real((block, width)),
        edge_messages=real((block, width)),
        coord_weights=real(block),
        pooled=real((1, 2 * width)),
    )


def build_head_weights(weights: Weights) -> HeadWeights:
    """Lay out the parameters of the heads, `summary_head.` and maybe `graph_head.`.

    The rows of all open layers come first, then those of the closing layers, if any.
    """
    branches = [name for name in BRANCHES if f"{name}_head.project.bias" in weights]
    mean = np.float32(1.0 / len(branches))

    def every(name: str) -> list[np.ndarray]:
        return [weights[f"{branch}_head.{name}"] for branch in branches]

    def filters(name: str) -> np.ndarray:
        turned = [weight.transpose(2, 1, 0) for weight in every(name)]
        return np.stack([weight.reshape(-1, weight.shape[2]) for weight in turned])

    inputs = every("project.weight")[-1].shape[1]
    channels = len(every("project.bias")[0])
    project = [
        np.pad(weight, [(0, 0), (0, inputs - weight.shape[1])])
        for weight in every("project.weight")
    ]
    layers = [OPEN_LAYER]
    if has_closing_layer(weights):
        layers.append(CLOSING_LAYER)
    rows = []
    biases = []
    for layer in layers:
        parts = [w.reshape(len(w), -1, channels) for w in every(f"{layer}.weight")]
        joined = np.concatenate(parts, axis=2) * mean
        rows.append(joined.reshape(len(joined), -1))
        biases.append(np.sum(every(f"{layer}.bias"), axis=0) * mean)
    return HeadWeights(
        project_weight=np.ascontiguousarray(np.concatenate(project).T),
        project_bias=np.concatenate(every("project.bias")),
        short_weight=filters("short.conv.weight"),
        short_bias=np.concatenate(every("short.bias")),
        long_weight=filters("long.conv.weight"),
        long_bias=np.concatenate(every("long.bias")),
        classify_weight=np.concatenate(rows),
        classify_bias=np.concatenate(biases),
    )


def create_head_state(weights: HeadWeights, slots: int) -> HeadState:
    """Return the state of a sequence before the first reading."""
    inputs, channels = weights.project_weight.shape
    return HeadState(
        slot=np.full(1, NO_SLOT),
        newest=np.zeros(inputs, np.float32),
        seen=np.zeros((SCALES, slots), np.bool_),
        values=np.zeros((SCALES, slots, channels), np.float32),
        indices=np.zeros(slots, np.int64),
        statistics=np.zeros((SCALES * STATISTICS, channels), np.float32),
    )


@final
class LogitStream:
    """A logit stream classifies the graphs of readings, each encoded only once.

    Attributes:
        logits: logits of each sequence at the latest reading, by its key.
        probabilities: calibrated probabilities, by the same keys.
        closing_logits: logits of the closing layer, by the same keys; those above where
            the network has none.
        closing_probabilities: calibrated probabilities of the closing layer.
    """

    def __init__(self, model: Model, builder: GraphBuilder) -> None:
        """Start before the first reading.

        Raises:
            ModelError: the weights do not fit the model's card.
        """
        self.network = Network(model)
        self.builder = builder
        self.heads = self.network.parts.heads
        classes = len(model.card.vocabulary)
        self.shape = (2, len(self.heads.classify_bias) // classes, classes)
        self.logits: dict[int, PerClass] = {}
        self.probabilities: dict[int, PerClass] = {}
        self.closing_logits: dict[int, PerClass] = {}
        self.closing_probabilities: dict[int, PerClass] = {}
        self.workspace: GraphWorkspace | None = None
        self.parts: Packed
        self.states: dict[int, Packed] = {}

    def compute_logits(self, reading: Reading, nodes: Mapping[int, TouchNodes]) -> None:
        """Compute the logits at the next reading from the nodes of each sequence.

        A sequence that is not among `nodes` has ended.
        """
        self.builder.start_step(reading)
        active = join_active(nodes)
        now = self.builder.step
        states = self.states
        self.states = {}
        self.logits = {}
        self.probabilities = {}
        self.closing_logits = {}
        self.closing_probabilities = {}
        for key, (taxels, earlier, history) in nodes.items():
            self.reserve(len(taxels) + len(earlier))
            state = states.get(key) or pack(
                create_head_state(self.heads, self.network.slots)
            )
            self.states[key] = state
            out = np.empty(self.shape, np.float32)
            step(self.parts, state, active, taxels, earlier, history, now, out)
            self.logits[key], self.probabilities[key] = out[:, 0]
            closing = out[:, -1]
            self.closing_logits[key], self.closing_probabilities[key] = closing

    def reserve(self, active: int) -> None:
        """Allocate more memory where a graph of so many active taxels needs it."""
        workspace = self.builder.reserve(active)
        if workspace is not self.workspace:
            self.workspace = workspace
            self.parts = self.pack_parts()

    def pack_parts(self) -> Packed:
        """Pack everything that a step needs, again whenever memory has grown."""
        builder = self.builder
        workspace = self.builder.workspace
        parts = self.network.reserve(*workspace.graph.neighbours.shape)
        history = builder.taxel_history
        return pack(StepParts(builder.geometry, history, workspace, parts))


def compute_probabilities(logits: PerClass, temperature: float) -> PerClass:
    """Return the softmax of logits divided by a temperature."""
    probabilities = np.empty_like(logits)
    write_probabilities(logits, temperature, probabilities)
    return probabilities
