"""This module implements the paper's network: an EGNN on the graph of all taxels.

From the paper: a node for every taxel, its pressure the node's feature (section IV-C1);
the kinematic distance as the edges' feature (IV-C2); K nearest neighbours (K = 8),
those inside a patch known beforehand and those of triggered taxels found live (IV-C4);
layers after Satorras et al. 2021 (its equation 2); 100 graphs a window (IV-C3); maximum
over the nodes (V-A). It gives neither widths nor depth nor what follows the pooling:
three layers of width 32, as ours has, and convolutions over time are our choice.

The paper also puts each taxel's pose from forward kinematics, a frame whose z axis is
the outward normal, into the node's feature (IV-C1), and calls the x of its equation 2
"poses", without saying how. That equation adds, subtracts and measures x, which is
defined for positions, and a pose among the features would break its equivariance. Ours
uses the position only, as x; normals are not used.
"""

from dataclasses import dataclass
from typing import Literal, final

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor, nn

from eskin.skin import MountedSkin
from eskin_paper_network.layer import PaperLayer
from eskin_paper_network.layer_kernels import find_largest
from eskin_paper_network.neighbours import (
    LENGTH_UNIT,
    Distance,
    Neighbourhood,
    TouchedGraph,
)

Pooling = Literal["max", "mean"]

WIDTH = 32
LAYERS = 3
CHANNELS = 64
TAPS = 5
LONGEST_STEP = 8
"""Readings between two taps of the last convolution over time: 0.16 s. Before it, steps
double from convolution to convolution, so that all of them together see a second."""

READINGS = 100
"""Readings of a window: two seconds at 50 Hz (section IV-C3)."""
STRIDES = (1, 2, 4)
"""Numbers of readings of which one may be used."""
PRESSURE_UNIT = 10.0
"""Unit of pressure [kPa]."""
TOUCHED = 0.5
"""Pressure below which a taxel reads zero [kPa]."""


@dataclass(frozen=True, eq=False)
class RestState:
    """A rest state holds the output of every layer for an untouched skin."""

    v: list[Float[Tensor, "taxel width"]]
    """Features before the first layer and after each."""
    x: list[Float[Tensor, "taxel 3"]]
    """Coordinates in the frames of the links, before the first layer and after each."""
    order: np.ndarray
    """Taxels by each channel of the last features, the largest first."""
    pooled: Float[Tensor, "width"]
    """Maximum or mean of the last features over all nodes."""


@final
class PaperNetwork(nn.Module):
    """This network applies an EGNN, pooling and convolutions over time.

    An untouched taxel reads zero, so after n layers a node more than n hops from all
    touched nodes and live edges is in the rest state: equivariant layers have the same
    output for it in any pose of its link. With `whole`, all nodes are computed at every
    reading, as in the paper; else only those that differ, with the same result.

    Attributes:
        whole: whether all nodes are computed at every reading.
        rest: rest state for these weights; None where it must be computed.
    """

    positions: Float[Tensor, "taxel 3"]

    def __init__(
        self,
        mounted: MountedSkin,
        classes: int,
        k: int,
        pooling: Pooling,
        distance: Distance = "kinematic",
        stride: int = 1,
    ) -> None:
        """Create the network for a skin.

        Args:
            mounted: the skin on its robot.
            classes: number of classes.
            k: number of neighbours of a taxel inside its patch.
            pooling: pooling over the nodes of a reading.
            distance: distance between taxels.
            stride: of so many readings of a window one is used, the newest among them.
        """
        super().__init__()
        if stride not in STRIDES:
            raise ValueError(
                f"stride is {stride}; allowed are {', '.join(map(str, STRIDES))}, so "
                "that the newest reading of a window is used"
            )
        self.mounted = mounted
        self.k = k
        self.distance: Distance = distance
        self.pooling: Pooling = pooling
        self.stride = stride
        self.whole = False
        self.rest: RestState | None = None
        self.near = Neighbourhood(mounted, k, distance)
        self.links = torch.from_numpy(mounted.taxel_link_index)
        # Where the pose is not used, all links have that of zero joint positions.
        joints = np.zeros(len(mounted.robot.joint_names))
        at_zero, _ = mounted.place_taxels(joints)
        own = mounted.skin.positions if self.near.uses_pose else at_zero
        self.register_buffer("positions", torch.from_numpy(own / LENGTH_UNIT).float())
        self.embed = nn.Linear(1, WIDTH)
        uses_length = self.near.uses_length
        self.layers = nn.ModuleList(
            PaperLayer(WIDTH, k, layer < LAYERS - 1, uses_length)
            for layer in range(LAYERS)
        )
        steps: list[nn.Module] = []
        channels = WIDTH
        dilation = 1
        while dilation * stride <= LONGEST_STEP:
            steps.append(nn.Conv1d(channels, CHANNELS, TAPS, dilation=dilation))
            steps.append(nn.SiLU())
            channels = CHANNELS
            dilation *= 2
        self.over_time = nn.Sequential(*steps, nn.AdaptiveMaxPool1d(1), nn.Flatten())
        self.out = nn.Linear(CHANNELS, classes)

    def forward(
        self,
        pressure: Float[Tensor, "clip 100 taxel"],
        q: Float[Tensor, "clip 100 joint"],
    ) -> Float[Tensor, "clip class"]:
        """Return the logits of each window.

        Args:
            pressure: pressure of each taxel [kPa], the oldest reading first.
            q: joint positions [rad].
        """
        pressure = pressure[:, self.stride - 1 :: self.stride]
        q = q[:, self.stride - 1 :: self.stride]
        features = self.encode(pressure.flatten(0, 1), q.flatten(0, 1))
        return self.classify_used(features.unflatten(0, pressure.shape[:2]))

    def classify(
        self, features: Float[Tensor, "clip 100 width"]
    ) -> Float[Tensor, "clip class"]:
        """Return the logits of windows of the features of each reading."""
        return self.classify_used(features[:, self.stride - 1 :: self.stride])

    def classify_used(
        self, features: Float[Tensor, "clip used width"]
    ) -> Float[Tensor, "clip class"]:
        """Return the logits of windows of the features of the used readings."""
        return self.out(self.over_time(features.transpose(1, 2)))

    def encode(
        self,
        pressure: Float[Tensor, "reading taxel"],
        q: Float[Tensor, "reading joint"],
    ) -> Float[Tensor, "reading width"]:
        """Return the features of each reading.

        Args:
            pressure: pressure of each taxel [kPa].
            q: joint positions [rad].
        """
        pressure = pressure.to(torch.float32)
        felt = torch.where(pressure >= TOUCHED, pressure / PRESSURE_UNIT, 0.0)
        rest = self.rest or self.compute_rest()
        if not self.training:
            self.rest = rest
        computed = torch.arange(len(felt))
        if not self.whole:
            computed = computed[(felt > 0).any(dim=1)]
        features = rest.pooled.expand(len(felt), -1)
        if len(computed) == 0:
            return features
        encoded = self.encode_touched(felt[computed], q[computed], rest)
        return features.index_copy(0, computed, encoded)

    def train(self, mode: bool = True) -> "PaperNetwork":
        """Switch between training and evaluation, and discard the rest state."""
        self.rest = None
        return super().train(mode)

    def encode_touched(
        self,
        felt: Float[Tensor, "reading taxel"],
        q: Float[Tensor, "reading joint"],
        rest: RestState,
    ) -> Float[Tensor, "reading width"]:
        """Return the features of readings with pressures in `PRESSURE_UNIT`."""
        joints = q.double().numpy()
        graph = self.near.select((felt > 0).numpy(), joints, LAYERS, self.whole)
        if self.near.uses_pose:
            T = self.mounted.kinematics.poses(joints)
            T[..., :3, 3] /= LENGTH_UNIT
            T_row = torch.from_numpy(T).float()[graph.reading, self.links[graph.node]]
        else:
            T_row = torch.eye(4).expand(len(graph.node), 4, 4)
        x = place_rows(T_row, rest.x[0][graph.node])
        v = self.embed(felt[graph.reading, graph.node, None])
        length = measure_edges(x.numpy(), graph)
        for n, (layer, count) in enumerate(zip(self.layers, graph.counts, strict=True)):
            first = graph.first[: count + 1]
            edges = slice(0, first[-1])
            computed, moved = layer(v, x, first, graph.source[edges], length[edges])
            if n + 1 < LAYERS:
                resting = graph.node[count:]
                v = torch.cat([computed, rest.v[n + 1].index_select(0, resting)])
                x_rest = rest.x[n + 1].index_select(0, resting)
                x = torch.cat([moved, place_rows(T_row[count:], x_rest)])
            else:
                v = computed
        return self.pool(v, graph, rest, len(felt))

    def compute_rest(self) -> RestState:
        """Return the output of every layer for an untouched skin."""
        x = self.positions
        v = self.embed(torch.zeros_like(x[:, :1]))
        table = self.near.table
        first = np.concatenate([[0], (table >= 0).sum(axis=1).cumsum()])
        every = torch.arange(len(x))
        source = table[table >= 0].astype(np.int32)
        graph = TouchedGraph(every, every, (len(x),), first, source)
        length = measure_edges(x.numpy(), graph)
        vs = [v]
        xs = [x]
        for layer in self.layers:
            v, x = layer(v, x, first, source, length)
            vs.append(v)
            xs.append(x)
        order = np.argsort(-v.detach().numpy(), axis=0)
        pooled = v.amax(dim=0) if self.pooling == "max" else v.mean(dim=0)
        return RestState(vs, xs, order, pooled)

    def pool(
        self,
        computed: Float[Tensor, "target width"],
        graph: TouchedGraph,
        rest: RestState,
        readings: int,
    ) -> Float[Tensor, "reading width"]:
        """Return the maximum or mean over all nodes of each reading (section V-A)."""
        nodes = rest.v[-1]
        reading = graph.reading[: len(computed)]
        taxels = graph.node[: len(computed)]
        if self.pooling == "mean":
            differences = computed - nodes.index_select(0, taxels)
            sums = nodes.sum(dim=0).expand(readings, -1)
            return sums.index_add(0, reading, differences) / len(nodes)
        largest = np.empty((readings, computed.shape[1]), np.int64)
        find_largest(
            computed.detach().numpy(),
            reading.numpy(),
            taxels.numpy(),
            nodes.detach().numpy(),
            rest.order,
            largest,
        )
        every = torch.cat([computed, nodes])
        return every.gather(0, torch.from_numpy(largest))


def place_rows(
    T: Float[Tensor, "row 4 4"], x: Float[Tensor, "row 3"]
) -> Float[Tensor, "row 3"]:
    """Return coordinates in the world, each moved by its own pose."""
    return (T[:, :3, :3] @ x[..., None])[..., 0] + T[:, :3, 3]


def measure_edges(
    x: Float[np.ndarray, "row 3"], graph: TouchedGraph
) -> Float[np.ndarray, "edge"]:
    """Return the distance between both ends of each edge."""
    target = np.repeat(np.arange(len(graph.first) - 1), np.diff(graph.first))
    return np.linalg.norm(x[target] - x[graph.source], axis=1)
