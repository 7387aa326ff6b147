"""This module recognises gestures live with the paper's network.

The network sees the whole skin, so all touches of a reading have the same
probabilities: those of the two seconds that end with it. Each reading is encoded once.
A network with a stride also answers at every reading, from those that lie whole strides
before it.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from eskin.live import SLOT_NS, Model, TouchClassifier, compute_probabilities
from eskin.recording import NONE
from eskin.touch import Reading, TouchPipeline, TouchState
from eskin_paper_network.model import load_network, read_settings
from eskin_paper_network.network import READINGS, PaperNetwork

LARGEST_PRESSURE = 300.0
"""Pressure to which readings are clipped [kPa], as in training."""
MAX_GAP = 500_000_000
"""Time without a reading after which a window begins again at rest [ns]."""


@contextmanager
def one_thread() -> Iterator[None]:
    """Compute without gradients in one thread, as is fastest for single readings."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        with torch.inference_mode():
            yield
    finally:
        torch.set_num_threads(threads)


@final
class FeatureWindow:
    """A feature window holds the features of the last slots, the oldest first.

    A reading belongs to the nearest slot after that of the reading before. The first
    of several in one slot counts, and a slot without any repeats the one before.

    Attributes:
        features: features of each slot.
    """

    def __init__(self, rest: Float[Tensor, "width"], slots: int) -> None:
        """Start with `slots` slots at rest, the features of an untouched skin."""
        self.rest = rest.expand(slots, -1)
        self.features: Float[Tensor, "slot width"] = self.rest
        self.stamp = -(2**62)

    def count_slots(self, stamp: int) -> int:
        """Return how many slots later a reading is than the newest slot."""
        return (stamp - self.stamp + (SLOT_NS - 1) // 2) // SLOT_NS

    def add_features(self, stamp: int, feature: Float[Tensor, "1 width"]) -> None:
        """Add the features of a reading that is in a later slot."""
        slots = self.count_slots(stamp)
        if stamp - self.stamp > MAX_GAP:
            self.features = self.rest
            self.stamp = stamp
            slots = 1
        else:
            self.stamp += slots * SLOT_NS
        held = self.features[-1:].expand(slots - 1, -1)
        self.features = torch.cat([self.features[slots:], held, feature])


@final
class PaperClassifier(TouchClassifier):
    """This classifier gives all touches the probabilities of the whole skin."""

    def __init__(self, model: Model, pipeline: TouchPipeline) -> None:
        """Start with an untouched skin; see `TouchClassifier`."""
        super().__init__(model, pipeline)
        settings = read_settings(model.card)
        self.network: PaperNetwork = load_network(model, pipeline.mounted)
        self.temperature = model.card.temperature
        vocabulary = model.card.vocabulary
        self.without = None if settings.knows_none else vocabulary.index(NONE)
        nothing = np.zeros(pipeline.mounted.skin.count, np.float32)
        q = np.zeros(len(pipeline.mounted.robot.joint_names))
        self.window = FeatureWindow(self.encode(nothing, q)[0], READINGS)
        self.is_classified = False
        self.answer = np.empty((2, len(vocabulary)), np.float32)

    def classify_touches(
        self, state: TouchState, floor: Float[np.ndarray, "taxel"] | None
    ) -> None:
        """Compute logits and probabilities at the next reading."""
        reading = state.reading
        if self.window.count_slots(reading.stamp) > 0:
            feature = self.encode(select_felt(reading, floor), reading.q)
            self.window.add_features(reading.stamp, feature)
            self.features = feature.numpy()[0]
            self.is_classified = False
        keys = self.list_keys(state)
        if keys and not self.is_classified:
            logits = self.classify()
            self.answer = np.stack(
                [logits, compute_probabilities(logits, self.temperature)]
            )
            self.is_classified = True
        self.logits = {key: self.answer[0] for key in keys}
        self.probabilities = {key: self.answer[1] for key in keys}

    def encode(
        self, pressure: Float[np.ndarray, "taxel"], q: Float[np.ndarray, "joint"]
    ) -> Float[Tensor, "1 width"]:
        """Return the features of one reading with pressures in kPa."""
        joints = torch.from_numpy(q.astype(np.float32))
        with one_thread():
            return self.network.encode(torch.from_numpy(pressure)[None], joints[None])

    def classify(self) -> Float[np.ndarray, "class"]:
        """Return the logits of the window; that of an unknown `none` is -inf."""
        with one_thread():
            logits = self.network.classify(self.window.features[None])[0].numpy()
        if self.without is None:
            return logits
        return np.insert(logits, self.without, -np.inf)


def select_felt(
    reading: Reading, floor: Float[np.ndarray, "taxel"] | None
) -> Float[np.ndarray, "taxel"]:
    """Return the pressure of each taxel that is valid and above its noise [kPa].

    Args:
        reading: the reading.
        floor: pressure up to which each taxel may be noise [kPa]; None for none.
    """
    is_felt = reading.valid
    if floor is not None:
        is_felt = is_felt & (reading.pressure >= floor)
    bounded = np.minimum(reading.pressure, np.float32(LARGEST_PRESSURE))
    return np.where(is_felt, bounded, np.float32(0.0)).astype(np.float32)
