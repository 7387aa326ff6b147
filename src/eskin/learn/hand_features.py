"""Hand-made features of a stretch of readings, for the classical baselines.

The kinds that studies of social touch use (as Jung et al. 2017 do): duration; mean,
spread and extremes of force, peak pressure, area, extents and change; displacement of
the centre; how much of the skin was touched; the spectrum of the force.
With shear, the same statistics of the shear.
"""

import numpy as np
from jaxtyping import Float, Int

from eskin.graph import GraphBatch
from eskin.graph.summary import centres, principal_extents, total, velocity
from eskin.learn.dataset import Dataset
from eskin.learn.segments import Segment

BANDS = (0.3, 1.0, 2.0, 3.0, 5.0)  # [Hz]

Series = Float[np.ndarray, "series reading"]


def segment_features(
    dataset: Dataset, segment: Segment, shear: bool
) -> Float[np.ndarray, "feature"]:
    """Features of one segment."""
    rows = np.arange(segment.first, segment.end)
    return stretch_features(dataset, rows, shear)


def stretch_features(
    dataset: Dataset, rows: Int[np.ndarray, "reading"], shear: bool
) -> Float[np.ndarray, "feature"]:
    """Features of consecutive rows of one sequence."""
    return graph_features(dataset.graphs.select(rows), dataset.stamps[rows], shear)


def graph_features(
    graphs: GraphBatch, stamps: Int[np.ndarray, "reading"], shear: bool
) -> Float[np.ndarray, "feature"]:
    """Features of the graphs of consecutive readings.

    Args:
        graphs: one a reading.
        stamps: of the readings [ns since the epoch].
        shear: whether the shear is among the features.
    """
    seconds = (stamps - stamps[0]) * 1e-9
    series = pressure_series(graphs)
    extent = np.ptp(centres(graphs.pressure * graphs.areas, graphs)[:, :2], axis=0)
    whole = [
        seconds[-1] + float(np.median(graphs.seconds)),
        *touched_area(graphs, series[2]),
        *extent,
        *bands(series[0], seconds),
    ]
    if shear:
        series = np.concatenate([series, shear_series(graphs)])
    return np.concatenate([whole, statistics(series)])


def pressure_series(graphs: GraphBatch) -> Series:
    """Force, peak, area, two extents, change and speed at each reading."""
    p, a = graphs.pressure, graphs.areas
    change = np.abs(p - graphs.before) * a / graphs.seconds[graphs.graph_index]
    peak = np.zeros(graphs.count)
    np.maximum.at(peak, graphs.graph_index, p)
    return np.stack(
        [
            total(p * a, graphs),
            peak,
            total(a * (p > 0), graphs),
            *principal_extents(graphs).T[:2],
            total(change, graphs),
            np.linalg.norm(velocity(graphs), axis=1),
        ]
    )


def shear_series(graphs: GraphBatch) -> Series:
    """Total, peak, net and change of shear at each reading."""
    size = np.linalg.norm(graphs.shear, axis=1)
    change = np.linalg.norm(graphs.shear - graphs.shear_before, axis=1)
    net = [total(graphs.shear[:, axis], graphs) for axis in range(3)]
    peak = np.zeros(graphs.count)
    np.maximum.at(peak, graphs.graph_index, size)
    change_rate = total(change, graphs) / graphs.seconds
    return np.stack(
        [total(size, graphs), peak, np.linalg.norm(net, axis=0), change_rate]
    )


def statistics(series: Series) -> Float[np.ndarray, "feature"]:
    """Mean, spread, maximum, minimum, median and mean step of each series."""
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


def touched_area(
    graphs: GraphBatch, area: Float[np.ndarray, "reading"]
) -> tuple[float, float]:
    """Area touched at any time [cm2], and how much that is of the largest at once."""
    pressed = graphs.pressure > 0
    taxels, first = np.unique(graphs.taxels[pressed], return_index=True)
    union = float(graphs.areas[pressed][first].sum()) if len(taxels) else 0.0
    return union, union / (float(area.max()) + 1.0)


def bands(
    force: Float[np.ndarray, "reading"], seconds: Float[np.ndarray, "reading"]
) -> Float[np.ndarray, "band"]:
    """Shares of the force's power in each band of `BANDS`."""
    if len(force) < 4:
        return np.zeros(len(BANDS) - 1)
    power = np.abs(np.fft.rfft((force - force.mean()) * np.hanning(len(force)))) ** 2
    hertz = np.fft.rfftfreq(len(force), np.diff(seconds).mean())
    sums = [
        power[(hertz >= low) & (hertz < high)].sum()
        for low, high in zip(BANDS[:-1], BANDS[1:], strict=True)
    ]
    return np.array(sums) / (power.sum() + 1e-9)
