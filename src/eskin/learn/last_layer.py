"""This module fits the last layers of a trained network, in closed form.

Gradient descent leaves the last layer short of what its statistics allow where there
are few examples. A ridge regression (Hoerl and Kennard 1970) of the classes on the same
statistics has other errors; the mean of both layers is again one layer, so that a
network costs no more.

The open layer answers while a touch is open: it is fitted on windows that end anywhere
in a touch. The closing layer answers when a touch closes: to the open layer it adds a
regression of what that leaves unexplained of windows that end with their touches.
"""

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn
from torch.nn.functional import one_hot

from eskin.learn.batches import BatchBuilder, Sampler
from eskin.learn.evaluation import compute_statistics
from eskin.learn.nn import RecogniserNetwork
from eskin.learn.nn.network import scatter_to_slots
from eskin.progress import track_progress

WINDOWS = 2048
BATCH = 64
"""Windows that the open layer is fitted on at most, and those computed at once."""
MOST_TOUCHES = 4096
"""Touches that the closing layer is fitted on at most, drawn at random."""

SLOPE = 4.0
"""Logits for a difference of one in probability, where probabilities are one half."""

Statistics = Float[Tensor, "window statistic"]
"""Statistics of all heads, side by side."""


@torch.no_grad()
def fit_open_layer(
    network: RecogniserNetwork,
    batches: BatchBuilder,
    windows: int,
    readings: int,
    ridge: float,
    rng: np.random.Generator,
) -> None:
    """Replace the open layer by its mean with the layer of a ridge regression.

    The logits of both spread alike over the windows drawn, apart from their offsets, so
    that probabilities are as sure as before. A network whose statistics are not finite
    stays as it is.

    Args:
        network: trained network, which is changed.
        batches: builder of the windows of training.
        windows: windows that training drew; no more than these are drawn.
        readings: readings of a window whose graphs are encoded.
        ridge: penalty of a squared weight, as a share of the variance of a statistic.
        rng: source of the random draws.
    """
    network.eval()
    count = min(windows, WINDOWS)
    x, labels = draw_statistics(network, batches, count, readings, rng)
    layers = [head.classify for head in network.heads]
    # The logits of the branches are averaged, those of the regression are their sum.
    trained = torch.cat([layer.weight for layer in layers], dim=1) / len(layers)
    shares = torch.full((len(x),), 1.0 / len(x), dtype=x.dtype)
    targets = one_hot(labels, network.classes).double()
    regressed, offsets = regress(x, targets, shares, ridge)
    if not torch.isfinite(regressed).all():
        return
    spreads = [spread(x @ weight.T) for weight in (trained.double(), regressed)]
    scale = spreads[0] / spreads[1].clamp(min=1e-9)
    parts = split_weights(scale * regressed, layers)
    for layer, part in zip(layers, parts, strict=True):
        layer.weight.lerp_(part, 0.5)
        layer.bias.lerp_((scale * offsets).to(layer.bias.dtype), 0.5)


@torch.no_grad()
def fit_closing_layer(
    network: RecogniserNetwork, sampler: Sampler, ridge: float, rng: np.random.Generator
) -> None:
    """Give a network a closing layer.

    To the logits of the open layer it adds a ridge regression of the differences of the
    true classes from its probabilities: a step of Newton's method where probabilities
    are near one half. It equals the open layer where statistics are not finite.

    Args:
        network: trained network, which is changed.
        sampler: sampler that draws the windows of training.
        ridge: penalty of a squared weight, as a share of the variance of a statistic.
        rng: source of the random choice where there are many touches.
    """
    network.eval()
    x, labels, weights = compute_closed_touches(network, sampler, rng)
    layers = network.add_closing_layer()
    trained = network.classify_statistics(x.to(layers[0].weight.dtype))
    targets = one_hot(labels, network.classes).double() - trained.double().softmax(1)
    regressed, offsets = regress(x, targets, weights, ridge)
    if not torch.isfinite(regressed).all():
        return
    parts = split_weights(SLOPE * regressed, layers)
    for layer, part in zip(layers, parts, strict=True):
        layer.weight.add_(part)
        layer.bias.add_((SLOPE * offsets).to(layer.bias.dtype))


def compute_closed_touches(
    network: RecogniserNetwork, sampler: Sampler, rng: np.random.Generator
) -> tuple[Statistics, Int[Tensor, "window"], Float[Tensor, "window"]]:
    """Return statistics, classes and weights of windows that end with their touches.

    Every segment that a sampler draws from has one window, which holds nothing from
    outside it, and weighs as much as it is drawn; of many segments some are chosen.
    """
    segments, labels, weights = sampler.list_segments()
    chosen = np.arange(len(segments))
    if len(segments) > MOST_TOUCHES:
        chosen = np.sort(rng.choice(len(segments), MOST_TOUCHES, replace=False))
    ends = np.array([segments[n].end - 1 for n in chosen])
    firsts = np.array([segments[n].first for n in chosen])
    x = compute_statistics(network, sampler.dataset, ends, firsts)
    share = torch.as_tensor(weights[chosen] / weights[chosen].sum())
    return x.double(), torch.as_tensor(labels[chosen]), share


def draw_statistics(
    network: RecogniserNetwork,
    batches: BatchBuilder,
    count: int,
    readings: int,
    rng: np.random.Generator,
) -> tuple[Statistics, Int[Tensor, "window"]]:
    """Draw some number of windows; return their statistics and classes.

    As in training, the summary is of all readings of a window, the graphs of some.
    """
    statistics = []
    labels = []
    starts = range(0, count, BATCH)
    for start in track_progress(starts, "fitting the last layer, part", len(starts)):
        size = min(BATCH, count - start)
        batch = batches.build(size, size, readings, rng)
        inputs = [(network.standardise(batch.summary), batch.slot_index)]
        if network.config.width:
            embedded = network.embed(batch.encoded.graphs)
            inputs.append((embedded, batch.encoded.slot_index))
        parts = [
            head.summarise(*scatter_to_slots(e, index, network.config.slots))
            for head, (e, index) in zip(network.heads, inputs, strict=True)
        ]
        statistics.append(torch.cat(parts, dim=1))
        labels.append(batch.labels)
    return torch.cat(statistics).double(), torch.cat(labels)


def split_weights(
    weights: Float[Tensor, "class statistic"], layers: list[nn.Linear]
) -> list[Float[Tensor, "class some"]]:
    """Return weights of all statistics as weights of layers, which are averaged."""
    parts = weights.split([layer.in_features for layer in layers], dim=1)
    return [len(layers) * part.to(layers[0].weight.dtype) for part in parts]


def regress(
    x: Statistics,
    targets: Float[Tensor, "window class"],
    weights: Float[Tensor, "window"],
    ridge: float,
) -> tuple[Float[Tensor, "class statistic"], Float[Tensor, "class"]]:
    """Return weights and offsets of a ridge regression.

    Args:
        x: statistics of windows.
        targets: regressed values of each class.
        weights: weight of each window; their sum is 1.
        ridge: penalty of a squared weight, as a share of the variance of a statistic.
    """
    share = weights[:, None]
    mean = (share * x).sum(dim=0)
    deviation = (share * (x - mean) ** 2).sum(dim=0).sqrt() + 1e-6
    z = (x - mean) / deviation
    level = (share * targets).sum(dim=0)
    gram = z.T @ (share * z) + ridge * torch.eye(z.shape[1], dtype=z.dtype)
    solved = torch.linalg.solve(gram, z.T @ (share * (targets - level)))
    found = solved.T / deviation
    return found, level - found @ mean


def spread(logits: Float[Tensor, "window class"]) -> Float[Tensor, ""]:
    """Return the standard deviation of logits about means of windows and classes."""
    centred = logits - logits.mean(dim=0)
    return (centred - centred.mean(dim=1, keepdim=True)).std()
