"""The summary of a contact graph in plain numpy, to hold the compiled one against."""

import numpy as np

from eskin.graph import GraphBatch
from eskin.graph.summary_kernels import (
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

NORM = np.linalg.norm


def reference_summary(graph: GraphBatch, shear: bool) -> np.ndarray:
    """The summary of a batch of one graph."""
    columns = pressure_columns(graph) + (shear_columns(graph) if shear else [])
    return np.array(columns)


def log(value, floor):
    return np.log1p(value / floor)


def centre_of(weights, graph):
    return (weights[:, None] * graph.positions).sum(axis=0) / max(weights.sum(), 1e-6)


def loads_of(graph):
    """Pressure times area now and before, and the velocity of its centre."""
    areas = graph.areas.astype(np.float64)
    now, before = graph.pressure * areas, graph.before * areas
    velocity = np.zeros(3)
    if now.sum() > 0 and before.sum() > 0:
        step = centre_of(now, graph) - centre_of(before, graph)
        velocity = step / graph.seconds[0]
    return now, before, velocity


def pressure_columns(graph):
    p, areas = graph.pressure.astype(np.float64), graph.areas.astype(np.float64)
    now, before, velocity = loads_of(graph)
    total, area = max(now.sum(), 1e-6), areas[p > 0].sum()
    force = now.sum() * N_PER_KPA_CM2
    above = [areas[p > level].sum() for level in LEVELS]
    offset = graph.positions - centre_of(now, graph)
    spread = np.einsum("n,ni,nj->ij", now, offset, offset) / total
    variances = np.maximum(np.linalg.eigvalsh(spread), 0.0)[::-1]
    extents = np.sqrt(variances + FLAT**2) - FLAT
    change = (now - before) * N_PER_KPA_CM2 / graph.seconds[0]
    loading, unloading = np.maximum(change, 0).sum(), np.maximum(-change, 0).sum()
    mean, square = now.sum() / (area + AREA), (p * now).sum() / (area + AREA)
    history = zip(graph.history[0], HISTORY_FLOORS, strict=True)
    return [
        log(force, FORCE),
        log(p.max(initial=0.0), PRESSURE),
        log(area, AREA),
        *(log(part, AREA) for part in above),
        *extents,
        extents[1] / (extents[0] + 0.1),
        NORM((now[:, None] * graph.normals).sum(axis=0)) / total,
        log(loading, RATE),
        log(unloading, RATE),
        log(loading + unloading, RATE) - log(force, FORCE),
        log(NORM(velocity), SPEED),
        mean / 50.0,
        np.sqrt(max(square - mean**2, 0.0)) / 50.0,
        log(square * area * N_PER_KPA_CM2**2, FORCE * 0.1) - 2 * log(force, FORCE),
        log(area, AREA) - log(above[-1], AREA),
        *(log(value, floor) for value, floor in history),
    ]


def shear_columns(graph):
    now, _, velocity = loads_of(graph)
    weights = graph.areas.astype(np.float64)[:, None] * N_PER_KPA_CM2
    s, earlier = graph.shear * weights, graph.shear_before * weights
    change = (s - earlier) / graph.seconds[0]
    size, rate = NORM(s, axis=1).sum(), NORM(change, axis=1).sum()
    net, net_before = s.sum(axis=0), earlier.sum(axis=0)
    offset = graph.positions - centre_of(now, graph)
    outward = offset / (NORM(offset, axis=1)[:, None] + NEAR)
    scale, force = size + FORCE, now.sum() * N_PER_KPA_CM2
    return [
        log(size, FORCE),
        log(NORM(graph.shear, axis=1).max(initial=0.0), PRESSURE),
        log(NORM(net), FORCE),
        NORM(net) / scale,
        log(size, FORCE) - log(force, FORCE),
        log(rate, RATE),
        log(NORM(change.sum(axis=0)), RATE),
        log(rate, RATE) - log(size, FORCE),
        (s * outward).sum() / scale,
        NORM(np.cross(outward, s).sum(axis=0)) / scale,
        (net * velocity).sum() / (scale * (NORM(velocity) + SPEED)),
        (net * net_before).sum() / (NORM(net) * NORM(net_before) + FORCE**2),
    ]
