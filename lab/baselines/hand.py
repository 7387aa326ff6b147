"""This module classifies windows by hand-crafted features of their contact graphs.

The features are of the kinds that studies of social touch use (Jung et al. 2017):
duration; mean, spread and extremes of force, peak pressure, area, extents and change;
displacement of the centre; touched area; spectrum of the force. With shear, the same
statistics of the shear.
"""

from collections import deque
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.learn.dataset import Dataset
from eskin.live import (
    PRESSURE_SUMMARY,
    GraphBatch,
    GraphBuilder,
    GraphConfig,
    compute_summary,
    join_graphs,
)
from eskin.live.summary_kernels import compute_load_motion
from eskin.skin import MountedSkin
from eskin.touch import Reading
from lab.baselines.interface import (
    READINGS,
    STEP_NS,
    TOUCHED,
    BaselineStream,
    RowBaseline,
    SkinWindows,
)

BANDS = (0.3, 1.0, 2.0, 3.0, 5.0)
"""Limits of the frequency bands [Hz]."""

FeatureSeries = Float[np.ndarray, "series reading"]


def compute_features(
    dataset: Dataset, rows: Int[np.ndarray, "reading"], shear: bool
) -> Float[np.ndarray, "feature"]:
    """Return the features of consecutive rows of one sequence."""
    graphs = dataset.graphs.select(rows)
    return compute_graph_features(graphs, dataset.stamps[rows], shear)


def compute_graph_features(
    graphs: GraphBatch, stamps: Int[np.ndarray, "reading"], shear: bool
) -> Float[np.ndarray, "feature"]:
    """Return the features of the graphs of consecutive readings.

    Args:
        graphs: graph of each reading.
        stamps: stamps of the readings [ns since the epoch].
        shear: whether to add features of the shear.
    """
    seconds = (stamps - stamps[0]) * 1e-9
    series = compute_pressure_series(graphs)
    extent = np.ptp(compute_load_motions(graphs)[0][:, :2], axis=0)
    whole = [
        seconds[-1] + float(np.median(graphs.seconds)),
        *compute_touched_area(graphs, series[2]),
        *extent,
        *compute_band_powers(series[0], seconds),
    ]
    if shear:
        series = np.concatenate([series, compute_shear_series(graphs)])
    return np.concatenate([whole, compute_statistics(series)])


def compute_pressure_series(graphs: GraphBatch) -> FeatureSeries:
    """Return force, peak, area, two extents, change and speed at each reading."""
    p = graphs.pressure
    a = graphs.areas
    column = PRESSURE_SUMMARY.index("length")
    extents = compute_summary(graphs, shear=False)[:, column : column + 2]
    change = np.abs(p - graphs.before) * a / graphs.seconds[graphs.graph_index]
    peak = np.zeros(graphs.size)
    np.maximum.at(peak, graphs.graph_index, p)
    return np.stack(
        [
            graphs.sum_nodes(p * a),
            peak,
            graphs.sum_nodes(a * (p > 0)),
            *extents.T,
            graphs.sum_nodes(change),
            np.linalg.norm(compute_load_motions(graphs)[1], axis=1),
        ]
    )


def compute_load_motions(
    graphs: GraphBatch,
) -> tuple[Float[np.ndarray, "graph 3"], Float[np.ndarray, "graph 3"]]:
    """Return the centre of the load of each graph [cm] and its velocity [cm/s].

    The centre is zero where there is no load, the velocity at first contact.
    """
    batch = graphs.for_kernels()
    motions = [compute_load_motion(batch, index)[1:] for index in range(graphs.size)]
    centres, velocities = np.array(motions).reshape(-1, 2, 3).swapaxes(0, 1)
    return centres, velocities


def compute_shear_series(graphs: GraphBatch) -> FeatureSeries:
    """Return total, peak, net and rate of change of shear at each reading."""
    size = np.linalg.norm(graphs.shear, axis=1)
    change = np.linalg.norm(graphs.shear - graphs.shear_before, axis=1)
    axes = [graphs.sum_nodes(graphs.shear[:, axis]) for axis in range(3)]
    net = np.linalg.norm(axes, axis=0)
    rate = graphs.sum_nodes(change) / graphs.seconds
    peak = np.zeros(graphs.size)
    np.maximum.at(peak, graphs.graph_index, size)
    return np.stack([graphs.sum_nodes(size), peak, net, rate])


def compute_statistics(series: FeatureSeries) -> Float[np.ndarray, "feature"]:
    """Return mean, spread, maximum, minimum, median and mean step of each series."""
    steps = np.abs(np.diff(series, axis=1, prepend=series[:, :1]))
    return np.concatenate(
        [
            series.mean(axis=1),
            series.std(axis=1),
            series.max(axis=1),
            series.min(axis=1),
            np.median(series, axis=1),
            steps.mean(axis=1),
        ]
    )


def compute_touched_area(
    graphs: GraphBatch, area: Float[np.ndarray, "reading"]
) -> tuple[float, float]:
    """Return the area of all touched taxels [cm2], and its ratio to the maximum."""
    pressed = graphs.pressure > 0
    taxels, first = np.unique(graphs.taxels[pressed], return_index=True)
    union = float(graphs.areas[pressed][first].sum()) if len(taxels) else 0.0
    return union, union / (float(area.max()) + 1.0)


def compute_band_powers(
    force: Float[np.ndarray, "reading"], seconds: Float[np.ndarray, "reading"]
) -> Float[np.ndarray, "band"]:
    """Return the share of the force's power in each of the bands `BANDS`."""
    if len(force) < 4:
        return np.zeros(len(BANDS) - 1)
    power = np.abs(np.fft.rfft((force - force.mean()) * np.hanning(len(force)))) ** 2
    hertz = np.fft.rfftfreq(len(force), np.diff(seconds).mean())
    sums = [
        power[(hertz >= low) & (hertz < high)].sum()
        for low, high in zip(BANDS[:-1], BANDS[1:], strict=True)
    ]
    return np.array(sums) / (power.sum() + 1e-9)


STAMPS = STEP_NS * np.arange(READINGS)


@final
class HandBaseline(RowBaseline):
    """This baseline classifies hand-crafted features of the whole skin in a window."""

    def build_streams(self) -> dict[str, BaselineStream]:
        """Return a stream that computes each reading's graph once."""
        return {"": HandStream(self)}

    def compute_rows(self, clips: SkinWindows) -> Float[np.ndarray, "clip feature"]:
        """Return the features of each window."""
        return np.stack(
            [
                self.compute_row(GraphWindow(self.mounted).fill(pressure, q))
                for pressure, q in zip(clips.pressure, clips.q, strict=True)
            ]
        )

    def compute_row(self, graphs: GraphBatch) -> Float[np.ndarray, "feature"]:
        """Return the features of one window's graphs."""
        return compute_graph_features(graphs, STAMPS, shear=False).astype(np.float32)


@final
class GraphWindow:
    """A graph window holds the graphs of the whole skin at the last readings."""

    def __init__(self, mounted: MountedSkin) -> None:
        """Start without a reading."""
        self.builder = GraphBuilder(mounted, GraphConfig().without_shear())
        self.valid = np.ones(mounted.skin.count, dtype=bool)
        self.graphs: deque[GraphBatch] = deque(maxlen=READINGS)
        self.earlier = np.empty(0, dtype=np.int64)
        self.stamp = 0

    def fill(
        self,
        pressure: Float[np.ndarray, "reading taxel"],
        q: Float[np.ndarray, "reading joint"],
    ) -> GraphBatch:
        """Add readings and return the graphs of the last ones."""
        for row, joints in zip(pressure.astype(np.float32), q, strict=True):
            self.push(row, joints)
        return join_graphs(self.graphs)

    def push(
        self, pressure: Float[np.ndarray, "taxel"], q: Float[np.ndarray, "joint"]
    ) -> None:
        """Add the graph of the next reading."""
        taxels = np.flatnonzero(pressure >= TOUCHED)
        reading = Reading(self.stamp, pressure, self.valid, q.astype(np.float64))
        self.builder.advance(reading, taxels)
        self.graphs.append(self.builder.build(taxels, self.earlier))
        self.earlier = taxels
        self.stamp = self.stamp + STEP_NS


@final
class HandStream(BaselineStream):
    """This stream computes only the newest graph at each reading."""

    def __init__(self, baseline: HandBaseline) -> None:
        """Start with a window without touch."""
        self.baseline = baseline
        mounted = baseline.mounted
        self.window = GraphWindow(mounted)
        q = np.zeros((READINGS, len(mounted.robot.joint_names)))
        self.window.fill(np.zeros((READINGS, mounted.skin.count), np.float32), q)

    def push(
        self, pressure: Float[np.ndarray, "taxel"], q: Float[np.ndarray, "joint"]
    ) -> Float[np.ndarray, "class"]:
        """Return the probabilities of the window that ends with this reading."""
        graphs = self.window.fill(pressure[None], q[None])
        row = self.baseline.compute_row(graphs)[None]
        return np.asarray(self.baseline.model.predict_proba(row))[0]
