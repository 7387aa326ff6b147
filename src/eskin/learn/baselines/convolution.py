"""Convolutional networks on grids of taxels."""

from collections.abc import Callable
from dataclasses import dataclass
from math import prod
from typing import final

import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor, nn

from eskin.learn.baselines.flat import BINS, KPA
from eskin.learn.baselines.interface import READINGS
from eskin.learn.baselines.network import NetworkBaseline, ReadingNetwork, WindowNetwork
from eskin.skin import Skin

PITCH = 0.008
"""Height of a pixel of the unrolled arm [m]: about the distance of taxels."""

ROUND = 48
"""TaxelsToImage round a link; the first and the last are neighbours."""

AXIS_TOLERANCE = 0.01
"""Directions are as good as an axis where their mean squared cosines with the normals
differ by less."""


@dataclass(frozen=True, eq=False)
class TaxelImage:
    """A place in an image for each taxel."""

    shape: tuple[int, int, int]
    """Rows, columns and channels."""

    place: Int[np.ndarray, "taxel"]
    """The pixel of each taxel, counted through the channels, columns and rows."""


def build_patch_image(skin: Skin) -> TaxelImage:
    """Each patch in a channel of its own, by row and column, padded to the largest."""
    rows = max(patch.rows for patch in skin.patches)
    columns = max(patch.columns for patch in skin.patches)
    channels = len(skin.patches)
    place = (skin.rows * columns + skin.columns) * channels + skin.patch_index
    return TaxelImage((rows, columns, channels), place.astype(np.int64))


def build_unrolled_image(skin: Skin) -> TaxelImage:
    """The links one above the other, each unrolled about its axis.

    A column is an angle, a row a height. Several taxels may meet in a pixel.
    """
    rows, columns = np.zeros((2, skin.count), np.int64)
    height = 0
    links = np.array(skin.link_names)[skin.patch_index]
    for link in dict.fromkeys(skin.link_names):
        here = np.flatnonzero(links == link)
        along, angle = unroll_about_axis(skin.positions[here], skin.normals[here])
        columns[here] = (angle / (2 * np.pi) * ROUND).astype(np.int64) % ROUND
        level = ((along - along.min()) / PITCH).astype(np.int64)
        rows[here] = height + level
        height += int(level.max()) + 1
    return TaxelImage((height, ROUND, 1), rows * ROUND + columns)


def unroll_about_axis(
    positions: Float[np.ndarray, "part 3"], normals: Float[np.ndarray, "part 3"]
) -> tuple[Float[np.ndarray, "part"], Float[np.ndarray, "part"]]:
    """Height [m] along the axis of a link's skin, and angle round it from 0 to 2 pi.

    The axis lies as far behind the skin as is right for a round one of this width whose
    normals spread as these do, or at most twice its width (root mean square), since
    that of a flat one would lie infinitely far away.
    """
    points = positions - positions.mean(axis=0)
    along, *across = np.linalg.svd(find_axis(points, normals)[None])[2]
    xy, n = points @ np.transpose(across), normals @ np.transpose(across)
    spread = max(n.var(axis=0).sum(), 0.25)
    x, y = (xy + n.mean(axis=0) * np.sqrt(xy.var(axis=0).sum() / spread)).T
    return points @ along, np.arctan2(y, x) % (2 * np.pi)


def find_axis(
    points: Float[np.ndarray, "part 3"], normals: Float[np.ndarray, "part 3"]
) -> Float[np.ndarray, "3"]:
    """The direction to which the normals are most perpendicular.

    Where several are as good, as on a flat skin, the one along which the points, whose
    mean is zero, lie farthest apart.
    """
    cosines, directions = np.linalg.eigh(normals.T @ normals / len(normals))
    free = directions[:, cosines < cosines[0] + AXIS_TOLERANCE]
    return free @ np.linalg.eigh(free.T @ points.T @ points @ free)[1][:, -1]


Pressure = Float[Tensor, "clip 100 taxel"]
JointPositions = Float[Tensor, "clip 100 joint"]
Logits = Float[Tensor, "clip class"]


class TaxelsToImage(nn.Module):
    """Lays pressures into the rows, columns and channels of an image.

    Convolutions want the channels before rows and columns in shape, and compute 1.6
    times as fast where they are the last in memory: callers move the axis.
    """

    place: Tensor

    def __init__(self, image: TaxelImage) -> None:
        """Remember where each taxel goes."""
        super().__init__()
        self.shape = image.shape
        self.register_buffer("place", torch.from_numpy(image.place))

    def forward(
        self, pressure: Float[Tensor, "*batch taxel"]
    ) -> Float[Tensor, "*batch row column channel"]:
        """Images in `KPA`, zero where there is no taxel.

        Where several taxels meet in a pixel, it shows the largest pressure.
        """
        felt = pressure / KPA
        flat = felt.new_zeros(*felt.shape[:-1], prod(self.shape))
        flat.scatter_reduce_(-1, self.place.expand_as(felt), felt, "amax")
        return flat.unflatten(-1, self.shape)


@final
class CnnLstm(ReadingNetwork):
    """Convolutions on each reading, then a recurrent network over the window.

    Each patch is a channel, "reshaped into a rectangular grid with padding" (section
    V-B), after Sarwar and Yamane 2021.
    """

    def __init__(self, skin: Skin, classes: int) -> None:
        """Make a network for a skin."""
        super().__init__()
        image = build_patch_image(skin)
        self.pixels = TaxelsToImage(image)
        self.convolutions = nn.Sequential(
            *build_strided_layers(nn.Conv2d, image.shape[-1], 16, 32, 32), nn.Flatten()
        )
        with torch.no_grad():
            size = self.convolved(torch.zeros(1, skin.count)).shape[1]
        self.reduce = nn.Sequential(nn.Linear(size, 64), nn.ReLU())
        self.lstm = nn.LSTM(64, 64, batch_first=True)
        self.out = nn.Linear(64, classes)

    def encode(
        self,
        pressure: Float[Tensor, "reading taxel"],
        q: Float[Tensor, "reading joint"],
    ) -> Float[Tensor, "reading 64"]:
        """Features of each reading; the pose is not looked at."""
        return self.reduce(self.convolved(pressure))

    def convolved(
        self, pressure: Float[Tensor, "reading taxel"]
    ) -> Float[Tensor, "reading pixel"]:
        """What the convolutions make of each reading."""
        return self.convolutions(self.pixels(pressure).movedim(-1, 1))

    def classify(self, features: Float[Tensor, "clip 100 64"]) -> Logits:
        """Logits from the largest of what each cell said within the window."""
        return self.out(self.lstm(features)[0].amax(dim=1))


@final
class Cnn3d(WindowNetwork):
    """Convolutions over time, rows and columns; each patch is a channel."""

    def __init__(self, skin: Skin, classes: int) -> None:
        """Make a network for a skin."""
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
        """Logits of each window; the pose is not looked at."""
        return self.out(self.convolutions(self.pixels(pressure).movedim(-1, 1)))


@final
class ImageCnn(WindowNetwork):
    """Convolutions on tactile images (Albini and Cannata 2020): the arm unrolled.

    The means of ten parts of the window are the channels. Round a link the first and
    the last column are neighbours.
    """

    def __init__(self, skin: Skin, classes: int) -> None:
        """Make a network for a skin."""
        super().__init__()
        self.pixels = TaxelsToImage(build_unrolled_image(skin))
        self.convolutions = nn.Sequential(
            *build_strided_layers(build_circular_convolution, BINS, 32, 64, 64),
            nn.AdaptiveMaxPool2d(1),
            nn.Flatten(),
        )
        self.out = nn.Linear(64, classes)

    def forward(self, pressure: Pressure, q: JointPositions) -> Logits:
        """Logits of each window; the pose is not looked at."""
        parts = pressure.unflatten(1, (BINS, READINGS // BINS)).mean(dim=2)
        return self.out(self.convolutions(self.pixels(parts)[..., 0]))


def build_circular_convolution(
    inputs: int, outputs: int, taps: int, stride: int, padding: int
) -> nn.Sequential:
    """A convolution to which the first and the last column are neighbours."""
    return nn.Sequential(
        nn.CircularPad2d((padding, padding, 0, 0)),
        nn.Conv2d(inputs, outputs, taps, stride, (padding, 0)),
    )


def build_strided_layers(
    convolution: Callable[[int, int, int, int, int], nn.Module], *channels: int
) -> list[nn.Module]:
    """Convolutions of three taps that halve every axis, each with a rectifier."""
    layers: list[nn.Module] = []
    for inputs, outputs in zip(channels[:-1], channels[1:], strict=True):
        layers += [convolution(inputs, outputs, 3, 2, 1), nn.ReLU()]
    return layers


@final
class CnnLstmBaseline(NetworkBaseline):
    """The CNN-LSTM of the paper's tables."""

    def build(self) -> CnnLstm:
        """Make the network."""
        return CnnLstm(self.mounted.skin, self.classes)


@final
class Cnn3dBaseline(NetworkBaseline):
    """A three-dimensional CNN."""

    def build(self) -> Cnn3d:
        """Make the network."""
        return Cnn3d(self.mounted.skin, self.classes)


@final
class ImageBaseline(NetworkBaseline):
    """A CNN on tactile images."""

    def build(self) -> ImageCnn:
        """Make the network."""
        return ImageCnn(self.mounted.skin, self.classes)
