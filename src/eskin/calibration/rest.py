"""This module estimates counts and noise of taxels at rest."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from eskin.skin import Skin
from eskin.touch import Adjacency, Calibration, Scan
from eskin.units import NS_PER_S

ROUNDING = 1.0 / np.sqrt(12.0)
"""Standard deviation of the error of rounding to whole counts."""
MAD_TO_SIGMA = 1.4826
"""Ratio of the standard deviation of a normal law to its median absolute deviation."""
OUTLIER = 3.5
"""Distance from rest, in standard deviations, beyond which a value is a spike."""
MIN_OUTLIER = 1.5
"""Smallest such distance [counts]: a step of the converter is no spike."""
PASSES = 4
"""Number of times that spikes are left out and the rest is measured again."""
MIN_SAMPLES = 20
"""Number of scans of a taxel from which its rest is measured."""
BLOCK = 2048
"""Number of taxels whose scans are converted at a time, to bound the memory."""
HAND_NOISE = 3.0
"""Noise of a taxel under a resting hand, in units of the median of its patch."""
HAND_PRESSURE = 1.0
"""Pressure above the median of the patch from which a hand may rest on a taxel [kPa].
"""
HAND_NEIGHBOURS = 2
"""Number of neighbours that such a taxel has under a hand."""


@dataclass(frozen=True, eq=False)
class RestEstimate:
    """An estimate of the rest of each taxel, from some seconds without touch."""

    rest: Float[np.ndarray, "taxel"]
    """Counts at rest, in the middle of the time."""
    noise: Float[np.ndarray, "taxel"]
    """Standard deviation about a straight course, without spikes; at least that of
    rounding [counts]."""
    measured: Bool[np.ndarray, "taxel"]
    """Which taxels were received often enough; others have the median of their patch.
    """


def estimate_rest(scans: Sequence[Scan], skin: Skin) -> RestEstimate:
    """Estimate rest and noise of each taxel from scans of a time without touch.

    Spikes are left out, and a drift at constant speed is no noise. Counts that change
    by whole steps, or never, have at least the noise of rounding.

    Raises:
        ValueError: no taxel was received often enough.
    """
    samples = np.zeros(skin.count, np.int64)
    for scan in scans:
        samples += scan.received
    measured = samples >= MIN_SAMPLES
    if not measured.any():
        raise ValueError(
            f"no taxel was received in {MIN_SAMPLES} of {len(scans)} scans without "
            f"touch; allowed are {MIN_SAMPLES} or more"
        )
    rest = np.zeros(skin.count)
    noise = np.zeros(skin.count)
    times = np.array([scan.stamp - scans[0].stamp for scan in scans]) / NS_PER_S
    for start in range(0, skin.count, BLOCK):
        part = slice(start, start + BLOCK)
        counts = np.array([scan.counts[part] for scan in scans], np.float64)
        received = np.array([scan.received[part] for scan in scans])
        counts = np.where(received, counts, np.nan)[:, measured[part]]
        found = np.flatnonzero(measured[part]) + start
        rest[found], noise[found] = measure_course(counts, times)
    fill_unmeasured(rest, measured, skin)
    fill_unmeasured(noise, measured, skin)
    return RestEstimate(rest, np.maximum(noise, ROUNDING), measured)


def measure_course(
    counts: Float[np.ndarray, "scan some"], times: Float[np.ndarray, "scan"]
) -> tuple[Float[np.ndarray, "some"], Float[np.ndarray, "some"]]:
    """Return the middle and the deviation of counts, NaN where not received."""
    third = max(len(counts) // 3, 1)
    ends = slice(None, third), slice(-third, None)
    have = np.all([np.isfinite(counts[end]).any(axis=0) for end in ends], axis=0)
    slope = np.zeros(counts.shape[1])
    early, late = (measure_level(counts[end][:, have])[0] for end in ends)
    apart = times[ends[1]].mean() - times[ends[0]].mean()
    slope[have] = (late - early) / max(apart, 1e-9)
    return measure_level(counts - slope * (times - times.mean())[:, None])


def measure_level(
    counts: Float[np.ndarray, "scan some"],
) -> tuple[Float[np.ndarray, "some"], Float[np.ndarray, "some"]]:
    """Return mean and deviation of counts without spikes, NaN where not received."""
    seen = np.isfinite(counts)
    middle = np.nanmedian(counts, axis=0)
    deviation = MAD_TO_SIGMA * np.nanmedian(np.abs(counts - middle), axis=0)
    filled = np.where(seen, counts, 0.0)
    for _ in range(PASSES):
        limit = np.maximum(OUTLIER * deviation, MIN_OUTLIER)
        used = seen & (np.abs(filled - middle) <= limit)
        number = np.maximum(np.count_nonzero(used, axis=0), 1)
        middle = np.where(used, filled, 0.0).sum(axis=0) / number
        squares = np.where(used, (filled - middle) ** 2, 0.0).sum(axis=0)
        deviation = np.sqrt(squares / np.maximum(number - 1, 1))
    return middle, deviation


def fill_unmeasured(
    values: Float[np.ndarray, "taxel"], measured: Bool[np.ndarray, "taxel"], skin: Skin
) -> None:
    """Give taxels without a measurement the median of their patch, or of all."""
    values[~measured] = np.median(values[measured])
    for patch in range(len(skin.patches)):
        members = skin.patch_index == patch
        if (members & measured).any():
            values[members & ~measured] = np.median(values[members & measured])


def find_resting_hand(
    estimate: RestEstimate, skin: Skin, calibration: Calibration
) -> Bool[np.ndarray, "taxel"]:
    """Find taxels on which a hand seems to have rested all the time.

    A hand never keeps still: where it rests, neighbouring taxels are both higher and
    noisier than the rest of their patch.
    """
    contact = calibration.compute_counts(HAND_PRESSURE)
    flags = np.zeros(skin.count, bool)
    for patch in range(len(skin.patches)):
        members = np.flatnonzero(skin.patch_index == patch)
        rest = estimate.rest[members]
        noise = estimate.noise[members]
        high = rest - np.median(rest) >= contact[members]
        flags[members] = high & (noise >= HAND_NOISE * np.median(noise))
    adjacency = Adjacency.build(skin)
    found = np.zeros(skin.count, bool)
    for i in np.flatnonzero(flags & estimate.measured):
        neighbours = adjacency.neighbours[slice(*adjacency.starts[i : i + 2])]
        found[i] = np.count_nonzero(flags[neighbours]) >= HAND_NEIGHBOURS
    return found
