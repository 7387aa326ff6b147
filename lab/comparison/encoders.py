"""This module defines encoders with one of the two poolings of ours, for the study."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Literal, final

import torch
from jaxtyping import Float
from torch import Tensor

from eskin.learn.nn import Encoder
from eskin.live import NetworkConfig

EncoderKind = Literal["equivariant", "max", "mean"]


@final
class OnePoolEncoder(Encoder):
    """This encoder pools in one way only, repeated to keep all sizes the same."""

    def __init__(self, config: NetworkConfig, kept: Literal["max", "mean"]) -> None:
        """Create the encoder with the pooling to keep."""
        super().__init__(config)
        self.kept = kept

    def combine(
        self,
        largest: Float[Tensor, "reading width"],
        mean: Float[Tensor, "reading width"],
    ) -> Float[Tensor, "reading embedding"]:
        """Return one of the two poolings, twice."""
        one = largest if self.kept == "max" else mean
        return torch.cat([one, one], dim=1)


ENCODERS: Mapping[EncoderKind, Callable[[NetworkConfig], Encoder]] = {
    "equivariant": Encoder,
    "max": partial(OnePoolEncoder, kept="max"),
    "mean": partial(OnePoolEncoder, kept="mean"),
}
"""Encoders by name; the first one is ours."""
