"""This package holds baselines: other classifiers, of windows of the whole skin."""

from collections.abc import Callable
from functools import partial

from eskin.skin import MountedSkin
from lab.baselines.convolution import (
    Cnn3d,
    CnnLstm,
    GridBaseline,
    ImageCnn,
)
from lab.baselines.estimators import (
    Estimator,
    GradientBoosting,
    LinearDiscriminant,
    NearestNeighbours,
    Perceptron,
    RandomForest,
    Standardised,
    SupportVectors,
)
from lab.baselines.flat import FlatBaseline
from lab.baselines.hand import HandBaseline
from lab.baselines.interface import (
    READINGS,
    Baseline,
    BaselineStream,
    SkinWindows,
)
from lab.baselines.network import FitConfig, NetworkBaseline, use_one_thread
from lab.baselines.paper import PaperBaseline
from lab.baselines.signal import SignalBaseline
from lab.baselines.spline import SplineBaseline

__all__ = [
    "BASELINES",
    "NETWORKS",
    "READINGS",
    "Baseline",
    "SkinWindows",
    "FitConfig",
    "NetworkBaseline",
    "PaperBaseline",
    "BaselineStream",
    "build_baseline",
    "use_one_thread",
]

ON_MAXIMA: dict[str, Callable[[int], Estimator]] = {
    "svm": SupportVectors(C=100.0),
    "knn": NearestNeighbours(k=1),
    "mlp": Perceptron(decay=0.1),
    "lda": LinearDiscriminant(),
}
ON_BINS: dict[str, Callable[[int], Estimator]] = {
    "svm": SupportVectors(C=100.0),
    "knn": NearestNeighbours(),
    "mlp": Perceptron(hidden=(512,)),
    "lda": LinearDiscriminant(),
}
BASELINES: dict[str, Callable[[MountedSkin], Baseline]] = {
    **{
        f"{name}-max": partial(FlatBaseline, estimator=estimator, features="maxima")
        for name, estimator in ON_MAXIMA.items()
    },
    **{
        f"{name}-bins": partial(FlatBaseline, estimator=estimator, features="bins")
        for name, estimator in ON_BINS.items()
    },
    "random-forest": partial(HandBaseline, estimator=RandomForest(trees=1000)),
    "gradient-boosting": partial(HandBaseline, estimator=GradientBoosting(leaves=31)),
    "spline-svm": partial(
        SplineBaseline, estimator=Standardised(SupportVectors(C=100.0))
    ),
    "signal-svm": partial(SignalBaseline, estimator=Standardised(SupportVectors())),
    "signal-mlp": partial(SignalBaseline, estimator=Standardised(Perceptron())),
}
"""Baselines that are not networks, by name, tuned on sets that no table uses."""

NETWORKS: dict[str, Callable[..., NetworkBaseline]] = {
    "cnn-lstm": partial(GridBaseline, network=CnnLstm),
    "3d-cnn": partial(GridBaseline, network=Cnn3d),
    "tactile-image": partial(GridBaseline, network=ImageCnn),
    "paper": PaperBaseline,
}
"""Baselines that are networks, by name."""


def build_baseline(
    name: str, mounted: MountedSkin, config: FitConfig | None = None
) -> Baseline:
    """Return a baseline that is not trained yet.

    Args:
        name: name in `BASELINES` or `NETWORKS`.
        mounted: the skin on its robot.
        config: settings of the training, where it is a network.

    Raises:
        ValueError: if there is none of that name.
    """
    if name in BASELINES:
        return BASELINES[name](mounted)
    if name in NETWORKS:
        return NETWORKS[name](mounted, config)
    raise ValueError(
        f"no baseline '{name}'; allowed are {', '.join((*BASELINES, *NETWORKS))}; "
        "choose one of them"
    )
