"""Measure how soon an arm is held after the last packet of its skin, or of one patch.

    python -m lab.attacks hold

Four patches scan at phases of their own. In each trial the packets of all of them or of
one stop at a random moment. The time to the hold is measured from the arrival of the
last packet, on a simulated clock. An arm is slowed before it is held where one patch
stops.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from eskin.units import NS_PER_S
from lab.attacks.delay import travel
from lab.attacks.played_line import (
    START,
    PlayedLine,
    PlayedPatch,
    merge_arrivals,
)
from lab.tables import format_head, format_row

PATCHES = 4
RATES = (50.0, 200.0)
LEAD = 1.0
"""Time for which all patches send at least, before a played trial [s]."""


def hold_played(rate: float, one: bool, seed: int) -> tuple[float, float]:
    """Return the times from the last packet to the limit and to the hold [s].

    The clock is simulated. The first is the time until the arm is slowed or held.
    """
    rng = np.random.default_rng((seed, 32))
    end = LEAD + rng.uniform(0.0, 0.2)
    errors = rng.uniform(-50e-6, 50e-6, PATCHES)
    patches = [
        PlayedPatch(number, rate, errors[number], rng.uniform())
        for number in range(PATCHES)
    ]
    streams = [
        travel(patch.send(end if number == 0 or not one else end + 1.0, None), rng)
        for number, patch in enumerate(patches)
    ]
    stopped = streams[:1] if one else streams
    last = max(stream[-1].arrived for stream in stopped)
    line = PlayedLine(patches, rate)
    line.check_at += int(rng.uniform(0.0, 0.02) * NS_PER_S)
    arrivals = list(merge_arrivals(*streams))
    line.play([a for a in arrivals if a.arrived <= last], (last - START) / NS_PER_S)
    line.arm.release()
    line.play([a for a in arrivals if a.arrived > last], end + 1.0)
    if line.arm.held_at is None:
        raise TimeoutError("the arm was not held within a second")
    limited = line.arm.limited_at or line.arm.held_at
    return (limited - last) / NS_PER_S, (line.arm.held_at - last) / NS_PER_S


@dataclass(frozen=True)
class Command:
    """Measure how soon an arm is held without packets."""

    trials: int = 200
    """Number of trials of each row."""
    seed: int = 0
    """Seed of the moments."""


def main(command: Command) -> None:
    """Print a table of the times."""
    print(format_head(["stops", "rate [Hz]", "trials", "p50", "p99", "longest [ms]"]))
    for one, rate in product((False, True), RATES):
        times = [
            hold_played(rate, one, 1000 * command.seed + trial)[1]
            for trial in range(command.trials)
        ]
        figures = [f"{1e3 * np.percentile(times, p):.0f}" for p in (50, 99, 100)]
        name = "one patch" if one else "all patches"
        cells = [name, f"{rate:g}", str(len(times)), *figures]
        print(format_row(cells), flush=True)
