"""What a model file says about its weights."""

from dataclasses import dataclass, field
from typing import Literal

from eskin.graph import GraphConfig
from eskin.model.config import NetworkConfig
from eskin.model.decision import DecisionConfig
from eskin.touch import PipelineConfig

FORMAT = "eskin-model-1"


@dataclass(frozen=True)
class ModelCard:
    """Everything beside the weights that recognition depends on, and their origin."""

    vocabulary: tuple[str, ...]
    """Classes in the order of the logits; `none` is one of them."""

    kind: Literal["pressure", "shear"] = "pressure"
    """What the skin must measure."""

    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Sizes of the network."""

    graph: GraphConfig = field(default_factory=GraphConfig)
    """How contacts become graphs."""

    pipeline: PipelineConfig = field(default_factory=PipelineConfig)
    """How counts become contacts."""

    decision: DecisionConfig = field(default_factory=DecisionConfig)
    """When it is sure enough to speak."""

    temperature: float = 1.0
    """Divides the logits, so that probabilities are calibrated."""

    training: dict[str, str] = field(default_factory=dict)
    """The training configuration, as text."""

    data_digest: str = ""
    """SHA-256 of the recordings trained on."""

    metrics: dict[str, float] = field(default_factory=dict)
    """What was measured at the end of training."""

    format: Literal["eskin-model-1"] = FORMAT
    """Version of this card."""

    @property
    def graph_used(self) -> GraphConfig:
        """The graphs that the network takes: a model for pressure knows no shear."""
        return self.graph if self.kind == "shear" else self.graph.without_shear()
