"""From the shares of each reading to the logits of each sequence."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.graph import GraphBuilder, HeldShares
from eskin.live.network import Network
from eskin.live.pool import FREE, fresh_pool, larger_pool
from eskin.live.step_kernels import StepParts, calibrate, step
from eskin.model import SLOT_NS, Model
from eskin.structref_kernels import Packed, pack
from eskin.touch import Reading

PerClass = Float[np.ndarray, "class"]

SEQUENCES = 8
"""That there are windows for at first."""


@final
class LogitStream:
    """The network on a stream: each graph is encoded once and remembered for 2 s.

    Attributes:
        network: the network.
        builder: of the graphs.
        logits: of each sequence at the latest reading, by its key.
        probabilities: the same, calibrated.
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
        self.memory = builder.memory
        self.parts = self.pack_parts()
        self.pool = fresh_pool(self.network.heads, self.network.slots, SEQUENCES)
        self.packed_pool = pack(self.pool)

    def push(self, reading: Reading, shares: HeldShares) -> None:
        """Take the next reading.

        A sequence without a share has ended.

        Args:
            reading: later than the one before.
            shares: one a sequence.
        """
        shear = self.builder.begin(reading)
        keys = shares.keys
        if not keys:
            self.pool.keys.fill(FREE)
            self.logits, self.probabilities = {}, {}
            return
        self.make_room(shares)
        builder = self.builder
        out = np.empty((len(keys), 2, self.classes), np.float32)
        step(
            self.parts,
            self.packed_pool,
            shares.packed,
            reading.pressure,
            shear,
            builder.T_world_link,
            builder.instant,
            reading.stamp // SLOT_NS,
            out,
        )
        self.logits = dict(zip(keys, out[:, 0], strict=True))
        self.probabilities = dict(zip(keys, out[:, 1], strict=True))

    def make_room(self, shares: HeldShares) -> None:
        """Take more memory where a graph, or all sequences at once, need it."""
        memory = self.builder.room_for(shares.most)
        if memory is not self.memory:
            self.memory, self.parts = memory, self.pack_parts()
        count = len(shares.keys)
        if count > len(self.pool.keys):
            self.pool = larger_pool(self.pool, self.network.heads, 2 * count)
            self.packed_pool = pack(self.pool)

    def pack_parts(self) -> Packed:
        """Hand over everything anew, where memory has grown."""
        builder, network = self.builder, self.network
        nodes, neighbours = builder.memory.neighbours.shape
        network.make_room(nodes, neighbours)
        parts = StepParts(
            ground=builder.ground,
            loads=builder.loads,
            graph=builder.memory,
            shear=network.shear,
            weights=network.weights,
            encoder=network.memory,
            features=network.out,
            heads=network.heads,
            temperature=self.temperature,
        )
        return pack(parts)


def calibrated(logits: PerClass, temperature: float) -> PerClass:
    """Probabilities that mean what they say."""
    probabilities = np.empty_like(logits)
    calibrate(logits, temperature, probabilities)
    return probabilities
