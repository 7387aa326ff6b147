"""Compute features of the true course of a touch."""

import numpy as np
from jaxtyping import Bool, Float
from scipy.signal import find_peaks

PERIOD = 0.02  # [s]
POINTS = 24
"""Number of points to which each series is resampled."""
LEAST = 0.05  # [N]
QUANTILES = (0.1, 0.25, 0.5, 0.75, 0.9)


def true_features(truth: Float[np.ndarray, "reading 5"]) -> Float[np.ndarray, "f"]:
    """Return numbers and resampled series of one touch.

    Args:
        truth: force [N], area [cm2] and centroid [cm] at every reading.
    """
    force = truth[:, 0]
    touched = np.flatnonzero(force > LEAST)
    if not len(touched):
        force = np.zeros_like(force)
        touched = np.array([0, 0])
    span = slice(touched[0], touched[-1] + 1)
    centre = filled(truth[span, 2:])
    return np.concatenate(
        [
            times(force, span),
            loads(truth[span, 0], truth[span, 1]),
            rhythm(truth[span, 0]),
            way(centre),
            resampled(truth[span, 0], centre, truth[span, 1]),
        ]
    )


def times(force: Float[np.ndarray, "reading"], span: slice) -> Float[np.ndarray, "f"]:
    """Return the times of contact, and whether the clip cuts it."""
    on = force[span] > LEAST
    changes = np.diff(on.astype(int))
    gaps = runs(~on)
    contacts = runs(on)
    return np.array(
        [
            (span.stop - span.start) * PERIOD,
            on.sum() * PERIOD,
            float(span.start == 0),
            float(span.stop == len(force)),
            np.count_nonzero(changes == -1),
            max(gaps, default=0) * PERIOD,
            max(contacts, default=0) * PERIOD,
            min(contacts, default=0) * PERIOD,
        ]
    )


def runs(flags: Bool[np.ndarray, "reading"]) -> list[int]:
    """Return the lengths of the runs of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [int(end - start) for start, end in edges.reshape(-1, 2)]


def loads(
    force: Float[np.ndarray, "part"], area: Float[np.ndarray, "part"]
) -> Float[np.ndarray, "f"]:
    """Return statistics of force, area and pressure."""
    pressure = np.divide(force, area, out=np.zeros_like(force), where=area > 0)
    top = int(force.argmax())
    own = [np.quantile(each, QUANTILES) for each in (force, area, pressure)]
    steps = np.diff(force, prepend=0.0, append=0.0)
    return np.concatenate(
        [
            *own,
            [force.max(), area.max(), pressure.max(), force.sum() * PERIOD],
            [area[top], pressure[top], area[top] / max(force[top], LEAST) ** 0.42],
            [top * PERIOD, (len(force) - top) * PERIOD, top / len(force)],
            [steps.max(), steps.min(), force.mean() / max(force.max(), LEAST)],
            [steps.max() / max(force.max(), LEAST)],
            [steps.min() / max(force.max(), LEAST)],
        ]
    )


def rhythm(force: Float[np.ndarray, "part"]) -> Float[np.ndarray, "f"]:
    """Return statistics of the peaks of the force and of its roughness."""
    padded = np.concatenate([[0.0], force, [0.0]])
    top = max(float(force.max()), LEAST)
    counts = [len(find_peaks(padded, prominence=p * top)[0]) for p in (0.05, 0.2, 0.5)]
    peaks = find_peaks(padded, prominence=0.2 * top)[0]
    apart, dip, second = 0.0, 1.0, 0.0
    if len(peaks) > 1:
        two = np.sort(peaks[np.argsort(-padded[peaks], kind="stable")[:2]])
        apart = (two[1] - two[0]) * PERIOD
        dip = padded[two[0] : two[1]].min() / top
        second = padded[two].min() / top
    rough = np.abs(np.diff(force, 2)).sum() / top if len(force) > 2 else 0.0
    widths = [np.mean(force > share * top) for share in (0.25, 0.5, 0.75, 0.9)]
    wide = [np.sum(force > share * top) * PERIOD for share in (0.1, 0.5, 0.9)]
    return np.array([*counts, apart, dip, second, rough, *widths, *wide])


def way(centre: Float[np.ndarray, "part 3"]) -> Float[np.ndarray, "f"]:
    """Return statistics of the motion of the centroid."""
    steps = np.diff(centre, axis=0)
    lengths = np.linalg.norm(steps, axis=1)
    path, away = lengths.sum(), np.linalg.norm(centre - centre[0], axis=1)
    speeds = lengths / PERIOD if len(lengths) else np.zeros(1)
    turns = np.sum(steps[1:] * steps[:-1], axis=1) < 0
    spread = np.sort(np.linalg.svd(centre - centre.mean(axis=0), compute_uv=False))
    return np.concatenate(
        [
            [path, away[-1], away.max(), away[-1] / max(path, 0.1), turns.sum()],
            [speeds.max(), np.quantile(speeds, 0.9), np.median(speeds)],
            [speeds.mean(), np.ptp(centre[:, 2]), np.ptp(centre[:, :2], axis=0).max()],
            np.resize(spread[::-1], 3) / np.sqrt(len(centre)),
        ]
    )


def filled(centre: Float[np.ndarray, "part 3"]) -> Float[np.ndarray, "part 3"]:
    """Fill gaps of the centroid with its last value, or with the origin."""
    known = np.isfinite(centre).all(axis=1)
    if not known.any():
        return np.zeros_like(centre)
    last = np.maximum.accumulate(np.where(known, np.arange(len(centre)), -1))
    return centre[np.maximum(last, int(np.flatnonzero(known)[0]))]


def resampled(
    force: Float[np.ndarray, "part"],
    centre: Float[np.ndarray, "part 3"],
    area: Float[np.ndarray, "part"],
) -> Float[np.ndarray, "f"]:
    """Return the shapes of force, area and distance from the start, resampled."""
    away = np.linalg.norm(centre - centre[0], axis=1)
    shape, size = force / max(force.max(), LEAST), area / max(area.max(), 1e-6)
    at = np.linspace(0, len(force) - 1, POINTS)
    known = np.arange(len(force))
    first = np.zeros(POINTS)
    early = force[:POINTS]
    first[: len(early)] = early
    return np.concatenate(
        [*(np.interp(at, known, each) for each in (shape, size, away)), first]
    )
