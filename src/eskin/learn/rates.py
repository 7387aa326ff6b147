"""A recording's scans at another rate than they were taken at."""

from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np

from eskin.recording import Recording
from eskin.touch import Scan
from eskin.units import NS_PER_S

LOOKED_AT = 50
"""Scans whose median distance is taken for the period."""
NEAR = 0.02
"""How far a ratio of rates may be from a whole number, for clocks are not the same."""
HOLE = 1.5
"""Scans farther apart than so many periods are no neighbours."""


def at_rate(recording: Recording, rate: float) -> Iterator[Scan]:
    """The scans at another rate, which is a multiple of theirs, or a whole part of it.

    Fewer are every so many-th of those that came. More are interpolated linearly, in
    counts that are rounded to whole ones and in joint positions: nothing is known that
    was not known before. After the last scan before a hole its counts are held.

    Args:
        recording: to read.
        rate: wanted [Hz].

    Raises:
        ValueError: neither rate is a multiple of the other.
    """
    stamps = [scan.stamp for scan in islice(recording.scans(), LOOKED_AT)]
    period = float(np.median(np.diff(stamps))) if len(stamps) > 1 else NS_PER_S
    ratio = rate * period / NS_PER_S
    times = max(ratio, 1 / ratio)
    if abs(times - round(times)) > NEAR * times:
        raise ValueError(
            f"rate is {rate:g} Hz of scans that came at {NS_PER_S / period:.1f} Hz; "
            "allowed are multiples and whole parts of that; take one of them"
        )
    if ratio < 1:
        return islice(recording.scans(), None, None, round(times))
    return interpolated(recording.scans(), round(times), round(period))


def interpolated(scans: Iterator[Scan], times: int, period: int) -> Iterator[Scan]:
    """So many times as many scans.

    Args:
        scans: that came.
        times: how many are wanted of each.
        period: of those that came [ns].
    """
    here: Scan | None = None
    for following in scans:
        if here is not None:
            near = following.stamp - here.stamp <= HOLE * period
            yield from filled(here, following if near else held(here, period), times)
        here = following
    if here is not None:
        yield from filled(here, held(here, period), times)


def held(scan: Scan, period: int) -> Scan:
    """The same a period [ns] later."""
    return replace(scan, stamp=scan.stamp + period)


def filled(one: Scan, other: Scan, times: int) -> Iterator[Scan]:
    """The first of two scans, and those on the way to the second."""
    yield one
    for step in range(1, times):
        share = step / times
        counts = (1 - share) * one.counts + share * other.counts
        shear = one.shear
        if one.shear is not None and other.shear is not None:
            shear = (1 - share) * one.shear + share * other.shear
            shear = np.rint(shear).astype(one.shear.dtype)
        yield Scan(
            stamp=one.stamp + (other.stamp - one.stamp) * step // times,
            counts=np.rint(counts).astype(one.counts.dtype),
            received=one.received & other.received,
            q=(1 - share) * one.q + share * other.q,
            shear=shear,
        )
