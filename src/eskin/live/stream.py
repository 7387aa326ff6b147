"""From the shares of each reading to the logits of each sequence."""

from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.graph import GraphBuilder, Share
from eskin.live.held import Held, hold
from eskin.live.network import Network
from eskin.live.step_kernels import StepParts, calibrate, step
from eskin.live.window import Window
from eskin.model import SLOT_NS, Model

PerClass = Float[np.ndarray, "class"]


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
        self.windows: dict[int, Window] = {}
        self.logits: dict[int, PerClass] = {}
        self.probabilities: dict[int, PerClass] = {}
        self.memory = builder.memory
        self.parts = self.hold_parts()

    def push(self, shares: Mapping[int, Share]) -> None:
        """Take the next reading, once the builder has taken it in.

        A sequence without a share has ended.

        Args:
            shares: one a sequence.
        """
        self.windows = {
            key: self.windows.get(key) or self.network.window() for key in shares
        }
        self.logits, self.probabilities = {}, {}
        for key, share in shares.items():
            found = self.step(share, self.windows[key])
            self.logits[key], self.probabilities[key] = found

    def step(self, share: Share, window: Window) -> Float[np.ndarray, "2 class"]:
        """Logits and probabilities of one sequence."""
        builder = self.builder
        memory = builder.room_for(len(share.taxels) + len(share.earlier))
        if memory is not self.memory:
            self.memory, self.parts = memory, self.hold_parts()
        now = builder.instant.stamp // SLOT_NS
        out = np.empty((2, window.classes), np.float32)
        step(
            self.parts,
            window.held,
            share.taxels,
            share.earlier,
            share.history,
            builder.T_world_link,
            builder.instant,
            window.now,
            now,
            out,
        )
        window.now = now
        return out

    def hold_parts(self) -> Held:
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
        return hold(parts)


def calibrated(logits: PerClass, temperature: float) -> PerClass:
    """Probabilities that mean what they say."""
    probabilities = np.empty_like(logits)
    calibrate(logits, temperature, probabilities)
    return probabilities
