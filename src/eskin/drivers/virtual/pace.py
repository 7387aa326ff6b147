"""Scans at another rate."""

from collections.abc import Iterable, Iterator

from eskin.touch import Scan
from eskin.units import NS_PER_S


def at_rate(scans: Iterable[Scan], rate: float) -> Iterator[Scan]:
    """The latest scan at every tick of another rate, so that all lasts as long.

    A scan comes several times where the rate is higher, and may be left out where it is
    lower.

    Args:
        scans: in the order of their stamps.
        rate: of the ticks, the first of which is at the first scan [1/s].
    """
    latest: Scan | None = None
    start = ticks = 0
    for scan in scans:
        if latest is None:
            start = scan.stamp
        else:
            while start + round(ticks * NS_PER_S / rate) < scan.stamp:
                yield latest
                ticks += 1
        latest = scan
    if latest is not None:
        yield latest
