"""This module defines convolutional networks on grids of taxels.

The paper gives the CNN-LSTM's input (section V-B), but no sizes; all sizes are ours.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from eskin.skin import MountedSkin, Skin
from lab.baselines.flat import PRESSURE_UNIT, TIME_BINS
from lab.baselines.interface import READINGS
from lab.baselines.network import (
    FitConfig,
    NetworkBaseline,
    ReadingNetwork,
    WindowNetwork,
)

PIXEL_HEIGHT = 0.008
"""Height of a pixel of the unrolled arm [m], about the distance between taxels."""

PIXELS_AROUND = 48
"""Pixels around a link; the first and the last are neighbours."""

AXIS_TOLERANCE = 0.01
"""Largest excess of a direction's mean squared cosine with the normals over the
smallest one, for the direction to be a candidate for the axis."""


@dataclass(frozen=True, eq=False)
class TaxelImage:
    """A taxel image assigns each taxel to a pixel."""

    shape: tuple[int, int, int]
    """Number of rows, columns and channels."""
    pixel: Int[np.ndarray, "taxel"]
    """Flat index of each taxel's pixel."""


def build_patch_image(skin: Skin) -> TaxelImage:
    """Return an image with a channel for each patch, padded to the largest."""
    rows = max(patch.rows for patch in skin.patches)
    columns = max(patch.columns for patch in skin.patches)
    channels = len(skin.patches)
    pixel = (skin.rows * columns + skin.columns) * channels + skin.patch_index
    return TaxelImage((rows, columns, channels), pixel.astype(np.int64))


def build_unrolled_image(skin: Skin) -> TaxelImage:
    """Return an image of the links on top of each other, each unrolled.

    A column is an angle about the link's axis, a row a height along it. Several taxels
    may share a pixel.
    """
    rows, columns = np.zeros((2, skin.count), np.int64)
    height = 0
    links = np.array(skin.link_names)[skin.patch_index]
    for link in dict.fromkeys(skin.link_names):
        here = np.flatnonzero(links == link)
        along, angle = unroll_about_axis(skin.positions[here], skin.normals[here])
        column = (angle / (2 * np.pi) * PIXELS_AROUND).astype(np.int64)
        columns[here] = column % PIXELS_AROUND
        level = ((along - along.min()) / PIXEL_HEIGHT).astype(np.int64)
        rows[here] = height + level
        height += int(level.max()) + 1
    return TaxelImage((height, PIXELS_AROUND, 1), rows * PIXELS_AROUND + columns)


def unroll_about_axis(
    positions: Float[np.ndarray, "part 3"], normals: Float[np.ndarray, "part 3"]
) -> tuple[Float[np.ndarray, "part"], Float[np.ndarray, "part"]]:
    """Return height along a link's axis [m], and angle about it from 0 to 2 pi [rad].

    The axis lies as far behind the skin as that of a round link of the same width and
    spread of normals, but at most twice the width (root mean square): the axis of a
    flat link would be infinitely far away.
    """
    points = positions - positions.mean(axis=0)
    along, *across = np.linalg.svd(find_axis(points, normals)[None])[2]
    xy = points @ np.transpose(across)
    n = normals @ np.transpose(across)
    spread = max(n.var(axis=0).sum(), 0.25)
    x, y = (xy + n.mean(axis=0) * np.sqrt(xy.var(axis=0).sum() / spread)).T
    return points @ along, np.arctan2(y, x) % (2 * np.pi)


def find_axis(
    points: Float[np.ndarray, "part 3"], normals: Float[np.ndarray, "part 3"]
) -> Float[np.ndarray, "3"]:
    """Return the direction that is most nearly perpendicular to all normals.

    Of several such, as on a flat skin, it is the one along which the points, whose mean
    is zero, have the largest variance.
    """
    cosines, directions = np.linalg.eigh(normals.T @ normals / len(normals))
    free = directions[:, cosines < cosines[0] + AXIS_TOLERANCE]
    return free @ np.linalg.eigh(free.T @ points.T @ points @ free)[1][:, -1]


Pressure = Float[Tensor, "clip 100 taxel"]
JointPositions = Float[Tensor, "clip 100 joint"]
Logits = Float[Tensor, "clip class"]


class TaxelsToImage(nn.Module):
    """This layer arranges pressures in the rows, columns and channels of an image.

    Convolutions take the channels before rows and columns, but are 1.6 times as fast
    where channels are last in memory, so callers move the axis of the result.
    """

    pixel: Tensor

    def __init__(self, image: TaxelImage) -> None:
        """Store the pixel of each taxel."""
        super().__init__()
        self.shape = image.shape
        self.register_buffer("pixel", torch.from_numpy(image.pixel))

    def forward(
        self, pressure: Float[Tensor, "*batch taxel"]
    ) -> Float[Tensor, "*batch row column channel"]:
        """Return images in `PRESSURE_UNIT`, zero in pixels without a taxel.

        Where several taxels share a pixel, it shows the largest pressure.
        """
        scaled = pressure / PRESSURE_UNIT
        flat = scaled.new_zeros(*scaled.shape[:-1], prod(self.shape))
        flat.scatter_reduce_(-1, self.pixel.expand_as(scaled), scaled, "amax")
        return flat.unflatten(-1, self.shape)


@final
class CnnLstm(ReadingNetwork):
    """This network applies convolutions to each reading, then an LSTM to the window.

    Each patch is a channel, "reshaped into a rectangular grid with padding" (section
    V-B), after Sarwar and Yamane 2021.
    """

    def __init__(self, skin: Skin, classes: int) -> None:
        """Create the network for a skin."""
        super().__init__()
        image = build_patch_image(skin)
        self.pixels = TaxelsToImage(image)
        self.convolutions = nn.Sequential(
            *build_strided_layers(nn.Conv2d, image.shape[-1], 16, 32, 32), nn.Flatten()
        )
        with torch.no_grad():
            size = self.convolve(torch.zeros(1, skin.count)).shape[1]
        self.reduce = nn.Sequential(nn.Linear(size, 64), nn.ReLU())
        self.lstm = nn.LSTM(64, 64, batch_first=True)
        self.out = nn.Linear(64, classes)

    def encode(
        self,
        pressure: Float[Tensor, "reading taxel"],
        q: Float[Tensor, "reading joint"],
    ) -> Float[Tensor, "reading 64"]:
        """Return the features of each reading; the pose is not used."""
        return self.reduce(self.convolve(pressure))

    def convolve(
        self, pressure: Float[Tensor, "reading taxel"]
    ) -> Float[Tensor, "reading pixel"]:
        """Return the output of the convolutions for each reading."""
        return self.convolutions(self.pixels(pressure).movedim(-1, 1))

    def classify(self, features: Float[Tensor, "clip 100 64"]) -> Logits:
        """Return logits from the maximum of each cell's output over the window."""
        return self.out(self.lstm(features)[0].amax(dim=1))


@final
class Cnn3d(WindowNetwork):
    """This network applies convolutions over time, rows and columns.

    Each patch is a channel.
    """

    def __init__(self, skin: Skin, classes: int) -> None:
        """Create the network for a skin."""
        super().__init__()
        image = build_patch_image(skin)
        self.pixels = TaxelsToImage(image)
        self.convolutions = nn.Sequential(
            *build_strided_layers(nn.Conv3d, image.shape[-1], 16, 32, 64),
            nn.AdaptiveMaxPool3d(1),
            nn.Flatten(),
        )
        self.out = nn.Linear(64, classes)

    def forward(self, pressure: Pressure, q: JointPositions) -> Logits:
        """Return the logits of each window; the pose is not used."""
        return self.out(self.convolutions(self.pixels(pressure).movedim(-1, 1)))


@final
class ImageCnn(WindowNetwork):
    """This network applies convolutions to tactile images (Albini and Cannata 2020).

    The image is the unrolled arm; the means of ten parts of the window are the
    channels. Around a link the first and the last column are neighbours.
    """

    def __init__(self, skin: Skin, classes: int) -> None:
        """Create the network for a skin."""
        super().__init__()
        self.pixels = TaxelsToImage(build_unrolled_image(skin))
        self.convolutions = nn.Sequential(
            *build_strided_layers(build_circular_convolution, TIME_BINS, 32, 64, 64),
            nn.AdaptiveMaxPool2d(1),
            nn.Flatten(),
        )
        self.out = nn.Linear(64, classes)

    def forward(self, pressure: Pressure, q: JointPositions) -> Logits:
        """Return the logits of each window; the pose is not used."""
        parts = pressure.unflatten(1, (TIME_BINS, READINGS // TIME_BINS)).mean(dim=2)
        return self.out(self.convolutions(self.pixels(parts)[..., 0]))


def build_circular_convolution(
    inputs: int, outputs: int, taps: int, stride: int, padding: int
) -> nn.Sequential:
    """Return a convolution for which the first and last columns are neighbours."""
    return nn.Sequential(
        nn.CircularPad2d((padding, padding, 0, 0)),
        nn.Conv2d(inputs, outputs, taps, stride, (padding, 0)),
    )


def build_strided_layers(
    convolution: Callable[[int, int, int, int, int], nn.Module], *channels: int
) -> list[nn.Module]:
    """Return convolutions of three taps that halve every axis, each with a ReLU."""
    layers: list[nn.Module] = []
    for inputs, outputs in zip(channels[:-1], channels[1:], strict=True):
        layers += [convolution(inputs, outputs, 3, 2, 1), nn.ReLU()]
    return layers


@final
class GridBaseline(NetworkBaseline):
    """This baseline is a network on grids of taxels."""

    def __init__(
        self,
        mounted: MountedSkin,
        config: FitConfig | None = None,
        *,
        network: Callable[[Skin, int], WindowNetwork],
    ) -> None:
        """Create an untrained baseline.

        Args:
            mounted: the skin on its robot.
            config: settings of the training.
            network: function that builds the network from skin and number of classes.
        """
        super().__init__(mounted, config)
        self.make = network

    def build(self) -> WindowNetwork:
        """Return the network."""
        return self.make(self.mounted.skin, self.classes)
