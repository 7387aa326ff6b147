"""Play a world to the front end, and count what it says beside the truth."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import final

import numpy as np

from eskin.touch import Scan, TouchPipeline, TouchState
from eskin.units import NS_PER_S
from lab.flaws.scoring import NEAR, Sample, Trail, TrueContact, find_root, score_touch
from lab.front_ends import END, ONSET
from lab.vary.worlds import World

LONGEST_ERROR = 2.0
"""Largest error of an onset or end that is counted as such [s]."""
LEAST_PEAK = 1.0
"""Peak force from which a true touch must be felt [N]."""
Outcomes = dict[str, str]
"""A figure of each true touch: 1 where it is right, 0 where not."""


@final
@dataclass(frozen=True)
class Figures:
    """Figures of one world."""

    outcomes: Outcomes
    """For each true touch whether it is felt, and whether its onset and its end are
    told in time."""
    counts: dict[str, float]
    """Numbers of the whole world."""


@final
@dataclass
class TouchWatch:
    """A watch follows the touches of a world; stateful."""

    pipeline: TouchPipeline
    trails: dict[int, Trail] = field(default_factory=dict)

    def push(self, scan: Scan) -> TouchState:
        """Process the next scan."""
        state = self.pipeline.push_scan(scan)
        for row in (*state.open, *state.closed):
            trail = self.trails.setdefault(row.id, Trail(row.id))
            trail.onset = row.onset
            trail.last = row.last
            trail.merged_into = row.merged_into
            if row.closed:
                continue
            place = np.array(row.contact.p_world)
            trail.samples.append(Sample(scan.stamp, row.force, place, ""))
        return state


def play(world: World) -> Figures:
    """Play a world to the front end that is imported."""
    watch = TouchWatch(TouchPipeline(world.mounted, world.calibration))
    sound = world.sound
    deaf = 0
    heard = 0
    masked = 0
    failed = 0
    faults = 0
    polarity = 0
    for scan in world.scans():
        state = watch.push(scan)
        missing = scan.received & ~state.reading.valid
        deaf += int(np.count_nonzero(missing & sound))
        heard += int(np.count_nonzero(scan.received & sound))
        masked += int(np.count_nonzero(missing & ~sound))
        failed += int(np.count_nonzero(scan.received & ~sound))
        faults += len(state.faults)
        polarity += any(one.kind in ("falling", "rising") for one in state.faults)
    scans = len(world.stamps)
    counts = {
        "deaf": deaf / max(heard, 1),
        "masked": masked / max(failed, 1),
        "faults": faults / scans,
        "polarity": polarity / scans,
    }
    outcomes, found = score_touches(world, watch)
    return Figures(outcomes, counts | found | count_false(world, watch))


def score_touches(world: World, watch: TouchWatch) -> tuple[Outcomes, dict[str, float]]:
    """Score each true touch."""
    outcomes: dict[str, list[bool]] = {name: [] for name in ("felt", "onsets", "ends")}
    onsets = []
    ends = []
    forces = []
    parts = 0
    for truth in world.truths:
        if truth.peak < LEAST_PEAK:
            continue
        near = list_near(truth, watch.trails)
        score = score_touch(truth, near)
        onset = score.onset_error
        end = score.end_error
        outcomes["felt"].append(onset is not None)
        outcomes["onsets"].append(onset is not None and abs(onset) <= ONSET)
        outcomes["ends"].append(end is not None and abs(end) <= END)
        parts += max(len({find_root(key, watch.trails) for key in near}) - 1, 0)
        if onset is not None and end is not None:
            onsets.append(float(np.clip(onset, -LONGEST_ERROR, LONGEST_ERROR)))
            ends.append(float(np.clip(end, -LONGEST_ERROR, LONGEST_ERROR)))
        forces.append(sum_force(truth, near))
    counts = {
        "touches": float(len(outcomes["felt"])),
        "onset error": mean(onsets),
        "end error": mean(ends),
        "force": mean(forces),
        "parts": float(parts),
    }
    texts = {
        name: "".join(str(int(one)) for one in values)
        for name, values in outcomes.items()
    }
    return texts, counts


def mean(values: list[float]) -> float:
    """Return the mean of some values; 0 of none."""
    return math.fsum(values) / len(values) if values else 0.0


def list_near(truth: TrueContact, trails: dict[int, Trail]) -> dict[int, Trail]:
    """Return the touches that are shown near a true contact in its time."""
    return (
        {
            key: trail
            for key, trail in trails.items()
            if any(True for _ in find_samples(truth, trail))
        }
        if truth.pressed.any()
        else {}
    )


def find_samples(truth: TrueContact, trail: Trail) -> Iterator[Sample]:
    """Yield the samples of a touch near a true contact in its time."""
    if not trail.samples or trail.samples[-1].stamp < truth.onset:
        return
    if trail.samples[0].stamp > truth.end:
        return
    places = np.searchsorted(truth.stamps, [one.stamp for one in trail.samples])
    for place, sample in zip(places.tolist(), trail.samples, strict=True):
        if truth.onset <= sample.stamp <= truth.end and sample.force > 0.0:
            gap = sample.p_world - truth.centre[place]
            if not math.sqrt(float(gap @ gap)) > NEAR:
                yield sample


def sum_force(truth: TrueContact, near: dict[int, Trail]) -> float:
    """Return the mean force that is shown during a true contact [N]."""
    samples = [one for trail in near.values() for one in find_samples(truth, trail)]
    return sum(one.force for one in samples) / np.count_nonzero(truth.pressed)


def count_false(world: World, watch: TouchWatch) -> dict[str, float]:
    """Count the touches that are shown without a true contact, and their time."""
    true: set[int] = set()
    for truth in world.truths:
        near = list_near(truth, watch.trails)
        true |= {find_root(key, watch.trails) for key in near}
    untouched = dict(zip(world.stamps.tolist(), world.untouched.tolist(), strict=True))
    openings = 0
    shown = 0
    for key, trail in watch.trails.items():
        if find_root(key, watch.trails) in true or not trail.samples:
            continue
        if untouched[trail.samples[0].stamp]:
            openings += 1
            shown += len(trail.samples)
    seconds = shown * float(np.median(np.diff(world.stamps))) / NS_PER_S
    return {"openings": float(openings), "false seconds": seconds}
