"""This module runs the compiled network on a stream of readings."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.compiled import Packed, pack
from eskin.live.graph_builder import GraphBuilder
from eskin.live.graph_stream import PackedTouchNodes
from eskin.live.model_config import SLOT_NS
from eskin.live.model_file import Model
from eskin.live.network import Network, create_pool, grow_pool
from eskin.live.step_kernels import FREE_ROW, StepParts, step, write_probabilities
from eskin.touch import Reading

PerClass = Float[np.ndarray, "class"]

INITIAL_SEQUENCES = 8
"""Number of sequences that there is memory for at first."""


@final
class LogitStream:
    """A logit stream classifies the graphs of readings, each encoded only once.

    Attributes:
        network: the network.
        builder: the builder of the graphs.
        logits: logits of each sequence at the latest reading, by its key.
        probabilities: calibrated probabilities, by the same keys.
    """

    def __init__(self, model: Model, builder: GraphBuilder) -> None:
        """Start before the first reading.

        Raises:
            ModelError: the weights do not fit the model's card.
        """
        self.network = Network(model)
        self.builder = builder
        self.temperature = model.card.temperature
        self.classes = len(self.network.heads.classify_bias)
        self.logits: dict[int, PerClass] = {}
        self.probabilities: dict[int, PerClass] = {}
        self.workspace = builder.workspace
        self.parts = self.pack_parts()
        self.pool = create_pool(
            self.network.heads, self.network.slots, INITIAL_SEQUENCES
        )
        self.packed_pool = pack(self.pool)

    def push(self, reading: Reading, nodes: PackedTouchNodes) -> None:
        """Compute the logits at the next reading.

        A sequence that is not among `nodes` has ended.

        Args:
            reading: reading later than the previous one.
            nodes: taxels and history of each sequence.
        """
        shear = self.builder.start_step(reading)
        keys = nodes.keys
        if not keys:
            self.pool.keys.fill(FREE_ROW)
            self.logits, self.probabilities = {}, {}
            return
        self.reserve(nodes)
        builder = self.builder
        out = np.empty((len(keys), 2, self.classes), np.float32)
        step(
            self.parts,
            self.packed_pool,
            nodes.packed,
            reading.pressure,
            shear,
            builder.T_world_link,
            builder.time_step,
            reading.stamp // SLOT_NS,
            out,
        )
        self.logits = dict(zip(keys, out[:, 0], strict=True))
        self.probabilities = dict(zip(keys, out[:, 1], strict=True))

    def reserve(self, nodes: PackedTouchNodes) -> None:
        """Allocate more memory where a graph or the number of sequences needs it."""
        workspace = self.builder.reserve(nodes.max_taxels)
        if workspace is not self.workspace:
            self.workspace, self.parts = workspace, self.pack_parts()
        count = len(nodes.keys)
        if count > len(self.pool.keys):
            self.pool = grow_pool(self.pool, self.network.heads, 2 * count)
            self.packed_pool = pack(self.pool)

    def pack_parts(self) -> Packed:
        """Pack everything that a step needs, again whenever memory has grown."""
        builder, network = self.builder, self.network
        network.reserve(*builder.workspace.graph.neighbours.shape)
        return pack(
            StepParts(
                geometry=builder.geometry,
                history=builder.taxel_history,
                workspace=builder.workspace,
                shear=network.shear,
                weights=network.weights,
                encoder=network.workspace,
                features=network.features,
                heads=network.heads,
                temperature=self.temperature,
            )
        )


def compute_probabilities(logits: PerClass, temperature: float) -> PerClass:
    """Return the softmax of logits divided by a temperature."""
    probabilities = np.empty_like(logits)
    write_probabilities(logits, temperature, probabilities)
    return probabilities
