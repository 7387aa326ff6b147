"""This module measures the force and pressure of every touch of a recording."""

from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from eskin.exports.limits import Limits, Region
from eskin.notebook import find_label
from eskin.progress import track_progress
from eskin.recording import Recording, select_labels
from eskin.skin import MountedSkin
from eskin.touch import Touch, TouchPipeline
from eskin.units import NS_PER_S

KPA = 1000.0
"""Pascal in a kPa."""
SILENT_SHARE = 0.1
"""Share of the readings from which on a taxel that is not valid is told."""

Series = dict[int, list[tuple[int, float, float, bool]]]
"""Stamp, force, pressure and whether clipped at each reading, by region."""


@dataclass(frozen=True, eq=False)
class TouchLoad:
    """A load describes what one touch does to one region."""

    touch: Touch
    """The touch as it was when it closed."""
    region: Region
    """Region that is loaded, with its limits."""
    gesture: str
    """Gesture of the touch's label, else of a recorded detection, else empty."""
    seconds: Float[np.ndarray, "reading"]
    """Times of its readings since the first of the recording [s]."""
    force: Float[np.ndarray, "reading"]
    """Force on the region [N]; 0 between its contacts."""
    pressure: Float[np.ndarray, "reading"]
    """Greatest pressure on one taxel of the region [kPa]."""
    held_force: float
    """Greatest force that was held for the time of quasi-static contact [N]."""
    held_pressure: float
    """Greatest pressure that was held for that time [kPa]."""
    is_clipped: bool
    """Whether a count reached the end of the converter's range: values are then lower
    bounds."""

    @property
    def values(self) -> dict[str, tuple[float, float | None]]:
        """Each value and its limit; None without one."""
        fast = self.region.transient
        slow = self.region.quasi_static
        return {
            "peak_force": (float(self.force.max()), fast.force),
            "peak_pressure": (float(self.pressure.max()), fast.pressure),
            "held_force": (self.held_force, slow.force),
            "held_pressure": (self.held_pressure, slow.pressure),
        }

    @property
    def above(self) -> list[str]:
        """Names of the values that are above their limits."""
        pairs = self.values.items()
        return [name for name, (v, limit) in pairs if limit is not None and v > limit]


@dataclass(frozen=True, eq=False)
class RecordingLoads:
    """All touches of a recording, with what limits their meaning."""

    recording: Recording
    """The recording."""
    limits: Limits
    """What touches are compared with."""
    loads: tuple[TouchLoad, ...]
    """Touches in the order of their onset, one entry a region."""
    seconds: float
    """Length of the recording [s]."""
    rate: float
    """Median rate of its readings [1/s]."""
    peaks: Float[np.ndarray, "taxel"]
    """Greatest pressure of each taxel in a touch [kPa]."""
    silent: Int[np.ndarray, "silent"]
    """Taxels that were not valid for a tenth of the readings or more."""

    def list_doubts(self) -> list[str]:
        """Return why forces and pressures may be other than they are here."""
        skin = self.recording.skin
        calibration = self.recording.calibration
        area = 1e6 * float(np.median(skin.areas))
        found = [
            f"A taxel reports the mean over its area (median {area:.0f} mm²): the "
            "pressure of a smaller contact is higher than is shown.",
            f"There are {self.rate:.0f} readings a second: a shorter peak "
            "is missed. What happens beside the skin is not in here.",
        ]
        if calibration.source == "nominal":
            found.append(
                "The skin was not calibrated: forces and pressures are relative, by a "
                "nominal curve. Measure its own with eskin calibrate."
            )
        if clipped := sum(load.is_clipped for load in self.loads):
            found.append(
                f"{clipped} of {len(self.loads)} loads reach the end of the "
                "converter's range (≥): they are lower bounds."
            )
        if len(self.silent):
            found.append(
                f"{len(self.silent)} of {skin.count} taxels were faulty or silent for "
                f"{SILENT_SHARE:.0%} of the time or more: what touched them is not in "
                "here."
            )
        if self.recording.truncated:
            found.append("The recording is cut short.")
        return found


def measure_loads(recording: Recording, limits: Limits) -> RecordingLoads:
    """Measure all touches of a recording as the live pipeline finds them."""
    skin = recording.skin
    calibration = recording.calibration
    pipeline = TouchPipeline(MountedSkin(skin, recording.load_robot()), calibration)
    series: dict[int, Series] = defaultdict(lambda: defaultdict(list))
    merged: dict[int, int] = {}
    touches: dict[int, Touch] = {}
    regions = limits.find_regions(skin)
    names = [region.name for region in regions]
    region_of = np.array(list(map(names.index, names)))[skin.patch_index]
    peaks: dict[int, np.ndarray] = {}
    invalid = np.zeros(skin.count, np.int64)
    stamps = []
    for scan in track_progress(recording.scans(), "readings", recording.count):
        state = pipeline.push_scan(scan)
        stamps.append(scan.stamp)
        invalid += ~state.reading.valid
        is_clipped = (
            scan.counts <= 0
            if calibration.falling
            else scan.counts >= calibration.full_scale
        )
        for row in state.rows:
            if row.closed:
                if not row.confirmed and not row.merged_into:
                    for kept in (peaks, series):
                        kept.pop(row.id, None)
                continue
            taxels = row.taxels
            pressure = state.reading.pressure[row.taxels]
            own = peaks.setdefault(row.id, np.zeros(skin.count))
            np.maximum.at(own, taxels, pressure)
            force = KPA * pressure * skin.areas[taxels]
            for region in {*region_of[taxels].tolist(), *series[row.id]}:
                here = region_of[taxels] == region
                values = (
                    float(force[here].sum()),
                    float(pressure[here].max(initial=0.0)),
                    bool(is_clipped[taxels[here]].any()),
                )
                series[row.id][region].append((scan.stamp, *values))
        merged |= {row.id: row.merged_into for row in state.rows if row.merged_into}
        touches |= {touch.id: touch for touch in state.closed_touches}
    touches |= {touch.id: touch for touch in pipeline.finish()}
    for id in [id for id in peaks if find_root(id, merged) not in touches]:
        del peaks[id]
    for id in sorted(merged):
        for region, rows in series.pop(id, {}).items():
            series[find_root(id, merged)][region] += rows
    labels = select_labels(recording.labels)
    loads = []
    for touch in sorted(touches.values(), key=lambda each: each.onset):
        for region, rows in series.get(touch.id, {}).items():
            times, force, pressure, is_clipped = join_rows(rows)
            seconds = (times - stamps[0]) / NS_PER_S
            named = find_label(touch, labels) or next(
                (d for d in recording.detections if d.onset == touch.onset), None
            )
            after = limits.quasi_static_after
            loads.append(
                TouchLoad(
                    touch=touch,
                    region=regions[region],
                    gesture="" if named is None else named.gesture,
                    seconds=seconds,
                    force=force,
                    pressure=pressure,
                    held_force=find_held(seconds, force, after),
                    held_pressure=find_held(seconds, pressure, after),
                    is_clipped=bool(is_clipped.any()),
                )
            )
    return RecordingLoads(
        recording=recording,
        limits=limits,
        loads=tuple(loads),
        seconds=(stamps[-1] - stamps[0]) / NS_PER_S if stamps else 0.0,
        rate=NS_PER_S / float(np.median(np.diff(stamps))) if stamps[1:] else 0.0,
        peaks=np.max([np.zeros(skin.count), *peaks.values()], axis=0),
        silent=np.flatnonzero(invalid >= max(SILENT_SHARE * len(stamps), 1)),
    )


def join_rows(rows: list[tuple[int, float, float, bool]]) -> tuple[Any, ...]:
    """Join the rows of touches that became one: forces at one time add up.

    Returns:
        Stamps, ascending; force, greatest pressure and whether clipped at each.
    """
    times, order = np.unique([row[0] for row in rows], return_inverse=True)
    force = np.zeros(len(times))
    pressure = np.zeros(len(times))
    is_clipped = np.zeros(len(times), bool)
    np.add.at(force, order, [row[1] for row in rows])
    np.maximum.at(pressure, order, [row[2] for row in rows])
    np.logical_or.at(is_clipped, order, [row[3] for row in rows])
    return times, force, pressure, is_clipped


def find_root(id: int, merged: dict[int, int]) -> int:
    """Return the touch into which a touch was merged in the end."""
    while id in merged:
        id = merged[id]
    return id


def find_held(
    seconds: Float[np.ndarray, "reading"],
    values: Float[np.ndarray, "reading"],
    duration: float,
) -> float:
    """Return the greatest value that was reached or exceeded for a time without end.

    Between two readings a value counts as the smaller of them.

    Args:
        seconds: times of the readings, ascending [s].
        values: value at each reading.
        duration: the time [s].
    """
    ends = np.searchsorted(seconds, seconds + duration - 1e-9)
    return max(
        (
            float(values[begin : end + 1].min())
            for begin, end in enumerate(ends.tolist())
            if end < len(values)
        ),
        default=0.0,
    )
