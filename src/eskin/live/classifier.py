"""This module defines classifiers of touches: that of eskin, and those of packages."""

from abc import ABC, abstractmethod
from collections.abc import Mapping
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.live.graph_builder import WHOLE_SKIN, GraphStream
from eskin.live.model_config import ESKIN
from eskin.live.model_file import Model, check_recogniser
from eskin.live.network import LogitStream, PerClass
from eskin.registry import RECOGNISERS, load_plugin
from eskin.touch import TouchPipeline, TouchState


class TouchClassifier(ABC):
    """A touch classifier gives logits to the open touches of one stream of readings.

    The readings of a touch are one sequence, whose key is the touch's id. On a skin
    that is not calibrated there is one sequence for the whole skin. Sequences begin
    before their touches are confirmed.

    The package of another recogniser derives a class and registers it by the package's
    own name in the entry points `eskin.recognisers`. Files whose card has that name as
    their `recogniser` are then used like any other.

    A class that answers differently for touches that close overrides `closing_logits`
    and `closing_probabilities`.

    Attributes:
        logits: logits of each sequence at the latest reading, by its key.
        probabilities: calibrated probabilities, by the same keys.
        features: features that the network has classified last.
    """

    def __init__(self, model: Model, pipeline: TouchPipeline) -> None:
        """Start before the first reading.

        Args:
            model: weights and their card.
            pipeline: pipeline that finds the touches.

        Raises:
            ModelError: the weights do not fit the model's card.
            SkinMismatchError: they cannot be used on the skin of the pipeline.
        """
        self.calibrated = pipeline.mounted.skin.calibrated
        self.logits: dict[int, PerClass] = {}
        self.probabilities: dict[int, PerClass] = {}
        self.features = np.empty(0, np.float32)

    @property
    def closing_logits(self) -> Mapping[int, PerClass]:
        """Logits for the decision about a touch when it closes, by the same keys."""
        return self.logits

    @property
    def closing_probabilities(self) -> Mapping[int, PerClass]:
        """Calibrated probabilities for that decision, by the same keys."""
        return self.probabilities

    @abstractmethod
    def classify_touches(
        self, state: TouchState, floor: Float[np.ndarray, "taxel"] | None
    ) -> None:
        """Compute logits and probabilities at the next reading.

        Args:
            state: the reading and its touches.
            floor: pressure up to which each taxel may be noise [kPa]; None where the
                reading was calibrated elsewhere.
        """

    def get_key(self, touch: int) -> int:
        """Return the key of the sequence that the touch with that id belongs to."""
        return touch if self.calibrated else WHOLE_SKIN

    def list_keys(self, state: TouchState) -> list[int]:
        """List the keys of the sequences that a reading belongs to."""
        if not self.calibrated:
            return [WHOLE_SKIN]
        return [touch.id for touch in state.tracking.open]


@final
class GraphClassifier(TouchClassifier):
    """A graph classifier encodes the contact graph of each touch, without torch."""

    def __init__(self, model: Model, pipeline: TouchPipeline) -> None:
        """Start before the first reading; see `TouchClassifier`."""
        super().__init__(model, pipeline)
        self.graphs = GraphStream(
            pipeline.mounted, model.card.graph_used, pipeline.tracker.poses
        )
        self.stream = LogitStream(model, self.graphs.builder)
        self.features = self.stream.network.parts.features

    @property
    def closing_logits(self) -> Mapping[int, PerClass]:
        """Logits of the closing layer, or of the open layer where there is none."""
        return self.stream.closing_logits

    @property
    def closing_probabilities(self) -> Mapping[int, PerClass]:
        """Calibrated probabilities of that layer."""
        return self.stream.closing_probabilities

    def classify_touches(
        self, state: TouchState, floor: Float[np.ndarray, "taxel"] | None
    ) -> None:
        """Compute logits and probabilities at the next reading."""
        nodes = self.graphs.find_touch_nodes(state)
        if nodes is not None:
            self.stream.compute_logits(state.reading, nodes)
        self.logits = self.stream.logits
        self.probabilities = self.stream.probabilities


def build_classifier(model: Model, pipeline: TouchPipeline) -> TouchClassifier:
    """Build the classifier that a model's card names.

    Raises:
        ModelError: no installed package registers it, or the weights do not fit.
    """
    name = model.card.recogniser
    if name == ESKIN:
        return GraphClassifier(model, pipeline)
    check_recogniser(name)
    return load_plugin(RECOGNISERS, name)(model, pipeline)
