"""This module fits the last layer of a trained network once more, in closed form.

Gradient descent leaves the last layer short of what its statistics allow where there
are few examples. A ridge regression (Hoerl and Kennard 1970) of the classes on the same
statistics has other errors; the mean of both layers is again one layer, so that a
network costs no more.
"""

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from eskin.learn.batches import BatchBuilder
from eskin.learn.nn import RecogniserNetwork
from eskin.learn.nn.network import scatter_to_slots

WINDOWS, BATCH = 2048, 64
"""Windows that the regression is fitted on, and those computed at once."""


@torch.no_grad()
def fit_last_layer(
    network: RecogniserNetwork,
    batches: BatchBuilder,
    readings: int,
    ridge: float,
    rng: np.random.Generator,
) -> None:
    """Replace the last layer by its mean with that of a ridge regression.

    The logits of both spread alike over the windows drawn, apart from their offsets, so
    that probabilities are as sure as before. A network whose statistics are not finite
    stays as it is.

    Args:
        network: trained network, which is changed.
        batches: builder of the windows of training.
        readings: readings of a window whose graphs are encoded.
        ridge: penalty of a squared weight, as a share of the variance of a statistic.
        rng: source of the random draws.
    """
    network.eval()
    x, labels = draw_statistics(network, batches, readings, rng)
    classes = [head.classify for head in network.heads]
    # The logits of the branches are averaged, those of the regression are their sum.
    trained = torch.cat([layer.weight for layer in classes], dim=1) / len(classes)
    regressed, offsets = regress(x, labels, network.classes, ridge)
    if not torch.isfinite(regressed).all():
        return
    spreads = [spread(x @ weight.T) for weight in (trained.double(), regressed)]
    scale = spreads[0] / spreads[1].clamp(min=1e-9)
    parts = (scale * regressed).split([layer.in_features for layer in classes], dim=1)
    for layer, part in zip(classes, parts, strict=True):
        layer.weight.lerp_(len(classes) * part.to(layer.weight.dtype), 0.5)
        layer.bias.lerp_((scale * offsets).to(layer.bias.dtype), 0.5)


def draw_statistics(
    network: RecogniserNetwork,
    batches: BatchBuilder,
    readings: int,
    rng: np.random.Generator,
) -> tuple[Float[Tensor, "window statistic"], Int[Tensor, "window"]]:
    """Draw windows; return the statistics of all heads, side by side, and classes.

    As in training, the summary is of all readings of a window, the graphs of some.
    """
    statistics, labels = [], []
    for _ in range(WINDOWS // BATCH):
        batch = batches.build(BATCH, BATCH, readings, rng)
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


def regress(
    x: Float[Tensor, "window statistic"],
    labels: Int[Tensor, "window"],
    classes: int,
    ridge: float,
) -> tuple[Float[Tensor, "class statistic"], Float[Tensor, "class"]]:
    """Return weights and offsets of the ridge regression of class indicators."""
    mean, deviation = x.mean(dim=0), x.std(dim=0) + 1e-6
    z = (x - mean) / deviation
    targets = torch.nn.functional.one_hot(labels, classes).double()
    shares = targets.mean(dim=0)
    gram = z.T @ z / len(z) + ridge * torch.eye(z.shape[1], dtype=z.dtype)
    weights = torch.linalg.solve(gram, z.T @ (targets - shares) / len(z)).T / deviation
    return weights, shares - weights @ mean


def spread(logits: Float[Tensor, "window class"]) -> Float[Tensor, ""]:
    """Return the standard deviation of logits about means of windows and classes."""
    centred = logits - logits.mean(dim=0)
    return (centred - centred.mean(dim=1, keepdim=True)).std()
