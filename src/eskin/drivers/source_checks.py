"""This module checks that a source keeps the rules of all sources.

A driver's own tests call `check_source`; `eskin doctor --source` observes a device.
"""

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float

from eskin.drivers.source import Source
from eskin.touch import Scan
from eskin.units import NS_PER_S

WAIT = 0.1
"""Longest wait for a scan [s]."""
MAX_OVERRUN = 0.5
"""Time by which a read may exceed its timeout on a busy computer [s]."""
MAX_LEAD = 50_000_000
"""Time by which a stamp may lie in the future [ns]."""


@dataclass(frozen=True, eq=False)
class Observation:
    """An observation tells what a source has returned for some time."""

    problems: tuple[str, ...]
    """Rules of sources that were broken, each once."""
    rates: Float[np.ndarray, "patch"]
    """Scans of each patch [1/s]."""
    ages: Float[np.ndarray, "patch"]
    """Age of the last scan of each patch [s]; inf without one."""


def observe_source(source: Source, seconds: float) -> Observation:
    """Read a source for a time, or to its end.

    Args:
        source: an open source, from which nobody else reads.
        seconds: the time by the source's clock [s].
    """
    skin = source.info.skin
    clock = source.clock
    counts = np.zeros(len(skin.patches))
    stamps = np.full(len(skin.patches), -np.inf)
    problems: dict[str, None] = {}
    kept: list[tuple[Scan, Scan]] = []
    before = source.counters().get("readings", 0)
    start = clock.now()
    last = -1
    number = 0
    while clock.now() - start < seconds * NS_PER_S and not source.ended:
        begun = time.monotonic()
        scan = source.read(WAIT)
        if time.monotonic() - begun > WAIT + MAX_OVERRUN:
            problems["read(timeout) returns later than after its timeout"] = None
        if scan is None:
            continue
        number += 1
        problems |= dict.fromkeys(find_problems(source, scan, last))
        last = scan.stamp
        if len(scan.received) != skin.count:
            continue
        heard = np.unique(skin.patch_index[scan.received])
        counts[heard] += 1
        stamps[heard] = scan.stamp
        if len(kept) < 10:
            kept.append((scan, Scan(*map(copy_value, scan_values(scan)))))
    if source.counters().get("readings", 0) - before != number:
        problems["counters()['readings'] is not the number of scans returned"] = None
    if any(
        not np.array_equal(one, two)
        for scan, copy in kept
        for one, two in zip(scan_values(scan), scan_values(copy), strict=True)
        if one is not None
    ):
        problems["arrays of a returned scan are written again"] = None
    ages = (clock.now() - stamps) / NS_PER_S
    return Observation(tuple(problems), counts / seconds, ages)


def scan_values(scan: Scan) -> tuple[Any, ...]:
    """Return the fields of a scan."""
    return scan.stamp, scan.counts, scan.received, scan.q, scan.shear


def copy_value(value: Any) -> Any:  # noqa: ANN401
    """Return a copy of an array; anything else as it is."""
    return value.copy() if isinstance(value, np.ndarray) else value


def find_problems(source: Source, scan: Scan, last: int) -> Iterator[str]:
    """Yield the rules that a scan breaks, after one with the stamp `last` [ns].

    A `Scan` itself refuses arrays of a wrong type, or of different lengths.
    """
    skin = source.info.skin
    if scan.stamp <= last:
        yield "stamps do not increase"
    elif scan.stamp > source.clock.now() + MAX_LEAD:
        yield "a stamp lies in the future of the source's clock"
    if len(scan.counts) != skin.count:
        yield f"counts are {len(scan.counts)}, not {skin.count}, one a taxel"
    if not 0 <= scan.counts.min(initial=0) <= scan.counts.max(initial=0) < 1 << 16:
        yield "counts are not within 0 to 65,535"
    if len(scan.q) != len(source.info.joint_names):
        yield "q is not one number a joint"
    if skin.has_shear != (scan.shear is not None):
        yield "shear is given without taxels that measure it, or not given with them"


def check_source(open_source: Callable[[], Source], seconds: float = 3.0) -> list[str]:
    """Return the rules of sources that a driver breaks; empty where it keeps them all.

    The source is opened, read, closed twice, and opened again.

    Args:
        open_source: function that opens the source of a device that sends.
        seconds: time for which it is read [s].
    """
    source = open_source()
    with source:
        found = list(observe_source(source, seconds).problems)
        if not source.counters().get("readings"):
            found.append("no scan comes from a device that sends")
        source.info.calibration.check_skin(source.info.skin)
        if source.info.rate <= 0:
            found.append("the rate of the source is not above 0")
    source.close()
    while source.read(0.0) is not None:
        pass
    if not source.ended:
        found.append("a closed source has not ended")
    with open_source() as again:
        if again.read(2.0) is None:
            found.append("a source that was closed cannot be opened again")
    return found
