"""The summary of a contact graph in plain numpy, to compare the compiled one with."""

import numpy as np
from numpy.linalg import norm

from eskin.live import GraphBatch
from eskin.live.summary_kernels import (
    AREA,
    FLAT,
    FORCE,
    HISTORY_FLOORS,
    LEVELS,
    N_PER_KPA_CM2,
    NEAR,
    PRESSURE,
    RATE,
    SPEED,
)


def reference_summary(graph: GraphBatch, shear: bool) -> np.ndarray:
    """Return the summary of a batch of one graph."""
    columns = pressure_columns(graph) + (shear_columns(graph) if shear else [])
    return np.array(columns)


def log(value, floor):
    return np.log1p(value / floor)


def load_motion(graph):
    """Return the load [N] now and before, its centre [cm] and velocity [cm/s]."""
    areas = graph.areas.astype(np.float64) * N_PER_KPA_CM2
    loads = graph.pressure * areas, graph.before * areas
    centre, before = (w @ graph.positions / max(w.sum(), 1e-7) for w in loads)
    pressed = loads[0].any() and loads[1].any()
    return *loads, centre, (centre - before) / graph.seconds[0] * pressed


def pressure_columns(graph):
    p, areas = graph.pressure.astype(np.float64), graph.areas.astype(np.float64)
    now, before, centre, velocity = load_motion(graph)
    force, total, area = now.sum(), max(now.sum(), 1e-7), areas[p > 0].sum()
    above = [areas[p > level].sum() for level in LEVELS]
    offset = graph.positions - centre
    spread = np.einsum("n,ni,nj->ij", now, offset, offset) / total
    variances = np.maximum(np.linalg.eigvalsh(spread), 0.0)[::-1]
    extents = np.sqrt(variances + FLAT**2) - FLAT
    change = (now - before) / graph.seconds[0]
    loading, unloading = np.maximum(change, 0).sum(), np.maximum(-change, 0).sum()
    mean, square = p @ areas / (area + AREA), p**2 @ areas / (area + AREA)
    history = zip(graph.history[0], HISTORY_FLOORS, strict=True)
    return [
        log(force, FORCE),
        log(p.max(initial=0.0), PRESSURE),
        log(area, AREA),
        *(log(part, AREA) for part in above),
        *extents,
        extents[1] / (extents[0] + 0.1),
        norm(now @ graph.normals) / total,
        log(loading, RATE),
        log(unloading, RATE),
        log(loading + unloading, RATE) - log(force, FORCE),
        log(norm(velocity), SPEED),
        mean / 50.0,
        np.sqrt(max(square - mean**2, 0.0)) / 50.0,
        log(square * area * N_PER_KPA_CM2**2, FORCE * 0.1) - 2 * log(force, FORCE),
        log(area, AREA) - log(above[-1], AREA),
        *(log(value, floor) for value, floor in history),
    ]


def shear_columns(graph):
    now, _, centre, velocity = load_motion(graph)
    weights = graph.areas.astype(np.float64)[:, None] * N_PER_KPA_CM2
    s, earlier = graph.shear * weights, graph.shear_before * weights
    change = (s - earlier) / graph.seconds[0]
    size, rate = norm(s, axis=1).sum(), norm(change, axis=1).sum()
    net, net_before = s.sum(axis=0), earlier.sum(axis=0)
    offset = graph.positions - centre
    outward = offset / (norm(offset, axis=1)[:, None] + NEAR)
    scale = size + FORCE
    return [
        log(size, FORCE),
        log(norm(graph.shear, axis=1).max(initial=0.0), PRESSURE),
        log(norm(net), FORCE),
        norm(net) / scale,
        log(size, FORCE) - log(now.sum(), FORCE),
        log(rate, RATE),
        log(norm(change.sum(axis=0)), RATE),
        log(rate, RATE) - log(size, FORCE),
        (s * outward).sum() / scale,
        norm(np.cross(outward, s).sum(axis=0)) / scale,
        net @ velocity / (scale * (norm(velocity) + SPEED)),
        net @ net_before / (norm(net) * norm(net_before) + FORCE**2),
    ]
