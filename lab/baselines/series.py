"""This module classifies a touch by nine series over its last two seconds.

MiniRocket (Dempster, Schmidt and Webb 2021) convolves them with fixed kernels, QUANT
(the same authors 2024) takes quantiles of intervals; both are built after the papers.
The third is what simple devices do: thresholds and timers.
"""

from dataclasses import dataclass
from itertools import combinations, product
from typing import final

import numpy as np
from jaxtyping import Float, Int
from numpy.lib.stride_tricks import sliding_window_view
from sklearn.base import BaseEstimator, ClassifierMixin
from sklearn.ensemble import ExtraTreesClassifier
from sklearn.linear_model import RidgeClassifierCV
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import StandardScaler

from eskin.live import PRESSURE_SUMMARY
from eskin.recording import NONE
from lab.baselines.estimators import Estimator, SoftmaxMachine
from lab.baselines.interface import READINGS

CHANNELS = (
    "force",
    "peak pressure",
    "area",
    "travel",
    "length",
    "breadth",
    "speed",
    "loading rate",
    "unloading rate",
)
"""Features of a reading that make the series: force, peak, area, path of the centroid,
spread, speed, rate of force; logarithmic, and without contact zero."""
COLUMNS = [PRESSURE_SUMMARY.index(name) for name in CHANNELS]

Series = Float[np.ndarray, "touch channel 100"]
Rows = Float[np.ndarray, "touch feature"]


def align_series(
    summary: Float[np.ndarray, "reading channel"], slots: Int[np.ndarray, "reading"]
) -> Float[np.ndarray, "channel 100"]:
    """Return the series of one touch by those of its readings, in bins of 20 ms.

    They end with the last reading; a missing reading repeats the one before, and before
    the touch all are zero.
    """
    bins = np.arange(slots[-1] - READINGS + 1, slots[-1] + 1)
    latest = np.searchsorted(slots, bins, side="right") - 1
    return np.where(latest >= 0, summary[latest].T, 0.0)


KERNELS = np.full((84, 9), -1.0)
"""All kernels of nine taps of which three are 2 and the others -1."""
for row, taps in zip(KERNELS, combinations(range(9), 3), strict=True):
    row[list(taps)] = 2.0
DILATIONS = np.unique(
    np.logspace(0, np.log2((READINGS - 1) / 8), 32, base=2).astype(int)
)
FEATURES = 9996 // len(KERNELS) // len(DILATIONS)
"""Number of features of a kernel and dilation: ten thousand in all."""


@final
class MiniRocket(BaseEstimator):
    """This transform takes the share of instants at which a convolution is large.

    Each kernel and dilation sees the sum of some channels, drawn at random. Thresholds
    are quantiles of the convolution of a touch drawn at random from training.
    """

    def __init__(self, seed: int) -> None:
        """Draw from a seed."""
        self.seed = seed

    def fit(self, X: Series, y: object = None) -> "MiniRocket":
        """Draw channels and thresholds; see series of training."""
        rng = np.random.default_rng(self.seed)
        self.scale_ = X.std(axis=(0, 2), keepdims=True) + 1e-9
        pairs = (len(DILATIONS), len(KERNELS))
        most = X.shape[1]
        counts = (2 ** rng.uniform(0, np.log2(most + 1), pairs)).astype(int)
        order = rng.random((*pairs, most)).argsort(axis=2).argsort(axis=2)
        self.mixes_ = (order < counts[..., None]).astype(float)
        chosen = rng.integers(len(X), size=pairs)
        golden = np.arange(1, np.prod(pairs) * FEATURES + 1) * (np.sqrt(5) + 1) / 2 % 1
        self.biases_ = golden.reshape(*pairs, FEATURES)
        for d, k in product(*map(range, pairs)):
            found = self.convolve(X[chosen[d, k]][None], d, k)
            self.biases_[d, k] = np.quantile(found, self.biases_[d, k])
        return self

    def transform(self, X: Series) -> Rows:
        """Return the features of series."""
        shares = []
        for d, k in product(range(len(DILATIONS)), range(len(KERNELS))):
            found = self.convolve(X, d, k)
            pad = 4 * DILATIONS[d]
            kept = found[:, pad:-pad] if (d + k) % 2 else found
            shares += [(kept > bias).mean(axis=1) for bias in self.biases_[d, k]]
        return np.stack(shares, axis=1)

    def convolve(self, X: Series, d: int, k: int) -> Float[np.ndarray, "touch 100"]:
        """Return the convolution by a dilation and a kernel, each by its number."""
        mixed = self.mixes_[d, k] @ (X / self.scale_)
        step = DILATIONS[d]
        padded = np.pad(mixed, [(0, 0), (4 * step, 4 * step)])
        return (
            sliding_window_view(padded, 8 * step + 1, axis=1)[..., ::step] @ KERNELS[k]
        )


def compute_interval_quantiles(series: Series, depth: int = 6) -> Rows:
    """Return the features of QUANT of series.

    They are quantiles of halves, quarters and so on, also shifted by half of one, of
    the series, its smoothed first and its second difference, and its spectrum.
    """
    first = np.pad(np.diff(series), [(0, 0), (0, 0), (2, 2)], mode="edge")
    smooth = sliding_window_view(first, 5, axis=2).mean(axis=3)
    spectrum = np.abs(np.fft.rfft(series))
    parts = []
    for form in (series, smooth, np.diff(series, 2), spectrum):
        length = form.shape[2]
        for count in 2 ** np.arange(min(depth, int(np.log2(length)) + 1)):
            bounds = np.linspace(0, length, count + 1).astype(int)
            spans = list(zip(bounds[:-1], bounds[1:], strict=True))
            if count > 1 and np.median(np.diff(bounds)) > 1:
                shift = int(np.ceil(length / count / 2))
                spans += [(low + shift, high + shift) for low, high in spans[:-1]]
            for low, high in spans:
                wanted = 1 + (high - low - 1) // 4
                shares = np.linspace(0, 1, wanted) if wanted > 1 else [0.5]
                found = np.quantile(form[..., low:high], shares, axis=2)
                found[1::2] -= form[..., low:high].mean(axis=2)
                parts.append(np.moveaxis(found, 0, 2).reshape(len(series), -1))
    return np.concatenate(parts, axis=1)


@final
class Quant(BaseEstimator):
    """This transform takes the quantiles of intervals."""

    def fit(self, X: Series, y: object = None) -> "Quant":
        """Learn nothing."""
        return self

    def transform(self, X: Series) -> Rows:
        """Return the features of series."""
        return compute_interval_quantiles(X)


@final
class Timers(ClassifierMixin, BaseEstimator):
    """This machine counts presses, and compares travel, area and time with thresholds.

    Two presses are a double pat; one that travels is a stroke; one that covers an area
    for a time is a grab; a short one is a poke; everything else is none. The thresholds
    are those that are best on the training touches, each tried in turn, twice.
    """

    tried = {
        "force": np.log1p(np.array([0.3, 0.6, 1.2, 2.5, 5.0]) / 0.3),
        "travel": np.log1p(np.array([1.0, 2.0, 3.0, 4.0, 6.0, 9.0])),
        "area": np.log1p(np.array([5.0, 10.0, 15.0, 20.0, 30.0, 45.0, 60.0])),
        "hold": np.array([10, 20, 30, 40, 60]),
        "short": np.array([20, 35, 50, 65, 80]),
    }

    def fit(self, X: Series, y: np.ndarray) -> "Timers":
        """Choose the thresholds; `y` are the names of gestures."""
        self.classes_ = np.unique(y)
        self.limits_ = {name: values[2] for name, values in self.tried.items()}
        for name in 2 * tuple(self.tried):
            kept = self.limits_
            options = [{**kept, name: value} for value in self.tried[name]]
            rates = []
            for self.limits_ in options:
                rates.append((self.predict(X) == y).mean())
            self.limits_ = options[int(np.argmax(rates))]
        return self

    def predict(self, X: Series) -> np.ndarray:
        """Return the gesture of each touch."""
        names = "force", "area", "travel"
        force, area, travel = (X[:, CHANNELS.index(name)] for name in names)
        limits = self.limits_
        on = force >= self.limits_["force"]
        presses = on[:, 0] + (on[:, 1:] & ~on[:, :-1]).sum(axis=1)
        steps = on.sum(axis=1)
        rules = {
            "double_pat": presses >= 2,
            "stroke": travel.max(axis=1) >= limits["travel"],
            "grab": (area.max(axis=1) >= limits["area"]) & (steps >= limits["hold"]),
            "poke": (presses == 1) & (steps < limits["short"]),
        }
        other = NONE if NONE in self.classes_ else "poke"
        return np.select(list(rules.values()), list(rules), other)

    def predict_proba(self, X: Series) -> Float[np.ndarray, "touch class"]:
        """Return certainty for the class of each touch."""
        return (self.predict(X)[:, None] == self.classes_).astype(float)


@final
@dataclass(frozen=True)
class SeriesClassifier:
    """This estimator builds a classifier of rows by a transform of series."""

    name: str
    """`minirocket`, with ridge regression, or `quant`, with extremely random trees."""

    def __call__(self, seed: int) -> Estimator:
        """Build the classifier."""
        if self.name == "quant":
            trees = ExtraTreesClassifier(
                200, criterion="entropy", max_features=0.1, random_state=seed
            )
            return make_pipeline(Quant(), trees)
        ridge = SoftmaxMachine(RidgeClassifierCV(np.logspace(-3, 3, 10)))
        return make_pipeline(MiniRocket(seed), StandardScaler(), ridge)


@final
@dataclass(frozen=True)
class TimerRules:
    """This estimator builds thresholds and timers, and ignores the seed."""

    def __call__(self, seed: int) -> Estimator:
        """Build the classifier."""
        return Timers()


SERIES = {
    "minirocket": SeriesClassifier("minirocket"),
    "quant": SeriesClassifier("quant"),
    "timers": TimerRules(),
}
"""Classifiers of series by name."""
