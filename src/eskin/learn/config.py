"""This module holds the settings of training, which a command reads without torch."""

from dataclasses import dataclass, field
from typing import Annotated

import numpy as np
from annotated_types import Interval

from eskin.files import NotNegative, Share
from eskin.live import GraphConfig, NetworkConfig, check_limits

AtLeastOne = Annotated[int, Interval(ge=1, le=np.inf)]


@dataclass(frozen=True)
class AugmentConfig:
    """These settings limit how far a training window differs from the recorded one."""

    gain: NotNegative = 0.4
    """Standard deviation of the logarithm of a person's force."""
    taxel_gain: NotNegative = 0.15
    """Standard deviation of the logarithm of each taxel's own gain."""
    dead: Share = 0.1
    """Largest share of taxels that read zero in a window."""
    offset: NotNegative = 2.0
    """Largest pressure subtracted from every taxel [kPa]."""
    shear_gain: NotNegative = 0.3
    """Standard deviation of the logarithm of shear relative to pressure."""
    noise: NotNegative = 0.0
    """Standard deviation of noise on each taxel's readings, as a share of its
    pressure."""
    patch: Share = 0.0
    """Share of windows in which one of several touched patches reads zero."""
    lost: Share = 0.0
    """Largest share of the readings of a window that are lost, as if never measured."""
    halved: Share = 0.0
    """Share of windows of a device of half the rate."""
    stretch: Share = 0.0
    """Standard deviation of the logarithm of a person's duration of a gesture."""
    crop: Share = 0.7
    """Share of windows that hold nothing from before their gesture."""

    def __post_init__(self) -> None:
        """Reject settings outside their limits."""
        check_limits(self)


NO_AUGMENTATION = AugmentConfig(
    gain=0.0, taxel_gain=0.0, dead=0.0, offset=0.0, shear_gain=0.0
)
"""Settings that leave windows as they were recorded."""


@dataclass(frozen=True)
class TrainConfig:
    """These settings determine how the recogniser is trained."""

    epochs: AtLeastOne = 10
    """Number of epochs of `steps` steps."""
    steps: AtLeastOne = 40
    """Steps in an epoch."""
    batch: AtLeastOne = 64
    """Windows in a step."""
    encoded: AtLeastOne = 32
    """Windows of a step whose graphs are encoded, the slowest part; the summary branch
    uses all windows."""
    readings: AtLeastOne = 25
    """Readings of an encoded window whose graphs are encoded, drawn at random."""
    rate: Annotated[float, Interval(ge=1e-9, le=1.0)] = 3e-3
    """Highest learning rate of the cycle."""
    decay: NotNegative = 0.3
    """Weight decay."""
    smoothing: Share = 0.1
    """Label smoothing."""
    ridge: NotNegative = 0.1
    """Penalty of the ridge regressions that fit the last layers at the end, for touches
    that are open and for those that close, each where that lowers the validation loss;
    0 leaves the network as trained, without a layer for touches that close. Those for
    open touches take a moment for every 64 windows, of as many as `epochs`, `steps` and
    `batch` give, at most 2048."""
    patience: Annotated[int, Interval(ge=0, le=np.inf)] = 5
    """Epochs without a lower validation loss after which one more stops training."""
    validation: Annotated[float, Interval(ge=0.0, le=0.9)] = 0.15
    """Share of the recordings held out to choose the epoch, in whole sessions; 0 trains
    to the end."""
    shares: dict[str, float] = field(default_factory=dict)
    """Names of data sets, each followed by the share of the windows of a class that are
    drawn from it; all other recordings are drawn with equal frequency."""
    shear: bool = True
    """Whether shear is used where every skin measures it."""
    workers: AtLeastOne = 1
    """Threads, one a core, that share the gradients of every batch; with dropout and
    more than one, results are not reproducible to the bit."""
    graph: GraphConfig = field(default_factory=GraphConfig)
    """Settings of the contact graphs."""
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    """Settings of the augmentation."""
    network: NetworkConfig = field(default_factory=NetworkConfig)
    """Sizes of the network."""

    def select_graph(self, has_shear: bool = True) -> GraphConfig:
        """Return the settings of the graphs that the network takes.

        Args:
            has_shear: whether every skin measures shear.
        """
        return self.graph.restrict(self.shear and has_shear, self.network.width > 0)

    def __post_init__(self) -> None:
        """Reject settings outside their limits."""
        check_limits(self)
        if min(self.shares.values(), default=0.0) < 0 or sum(self.shares.values()) > 1:
            raise ValueError(
                f"shares are {self.shares}; allowed are numbers from 0 on whose sum is "
                "at most 1"
            )
