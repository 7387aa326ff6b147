"""Measure an arm that simulated people command by touch, in all conditions.

    python -m lab.commanded_arm                     # all rows, hours
    python -m lab.commanded_arm --builds 1 --seconds 20 --only fresh storm
    python -m lab.commanded_arm --commands paper    # with another command map

Every row is `eskin demo --headless` in one condition: on sensors as in training, aged
ones and those of each family, with short and long pauses between touches, on a slow and
a fast arm, and on skins that fail meanwhile. Each build of the skin has people of its
own; neither is in any set, nor were thresholds chosen on them. Builds of a family with
less than 20 readings a second command no arm and are left out.

A touch that asks for more and its answer count as one; of a hundred questions, people
forget to answer five, and answer five by another gesture. Intervals are those of 95 %
of resampled builds with their people (percentile bootstrap). The command prints a table
of docs/results.md, and below it why touches were lost.
"""

from collections import Counter
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Float

from eskin.errors import ArmError
from eskin.learn.metrics import resample_clusters
from eskin.sim.demo import (
    DemoConfig,
    DemoResult,
    SimulatedUserConfig,
    StormConfig,
)
from eskin.sim.demo.headless import merge_results, run_build
from eskin.sim.demo.score import count_going_on
from eskin.sim.sensor import FAMILIES
from lab.tables import format_head, format_row

SHORT = (0.6, 0.8)
LONG = (1.5, 3.5)
"""Shortest and longest time from one touch to the next [s]."""

FRESH = DemoConfig(user=SimulatedUserConfig(pause=SHORT))
ROWS: dict[str, DemoConfig] = {
    "fresh": FRESH,
    "fresh, long pauses": replace(FRESH, user=SimulatedUserConfig(pause=LONG)),
    "shifted": replace(FRESH, build_kind="shifted"),
    "shifted, long pauses": replace(
        FRESH, build_kind="shifted", user=SimulatedUserConfig(pause=LONG)
    ),
    **{family: replace(FRESH, build_kind=family) for family in FAMILIES},
    "half speed": replace(FRESH, arm_speed=0.5),
    "one and a half speed": replace(FRESH, arm_speed=1.5),
    **{
        f"storm: {100 * loss:g} % of the scans lost": replace(
            FRESH, storm=StormConfig(loss=loss)
        )
        for loss in (0.002, 0.01, 0.05)
    },
    "storm: a patch unplugged every 30 s": replace(
        FRESH, storm=StormConfig(unplug_period=30.0)
    ),
    "storm: 10 % of the taxels dead": replace(FRESH, storm=StormConfig(dead=0.1)),
}
"""Conditions by their names in the table."""


HEAD = [
    "condition",
    "touches",
    "obeyed",
    "wrong",
    "accidents",
    "stops by accidents",
    "unasked to go on an hour",
    "command after the end p50 / p95 [s]",
    "stop after the onset p50 / p95 [s]",
    "arm not held",
    "commands of faults",
    "to go on",
    "questions",
    "answered",
]


@dataclass(frozen=True)
class Command:
    """Measure an arm that simulated people command by touch."""

    builds: int = 30
    """Number of builds of each row; 30 have 1,000 touches and 600 accidents."""
    seconds: float = 120.0
    """Simulated time of each build [s]."""
    only: tuple[str, ...] = ()
    """Parts of the names of the rows to measure; by default all."""
    seed: int = 20000
    """Seed of the first build and its people; the others follow."""
    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""
    commands: Path | None = None
    """Command map: a file, or `paper`; the default one unless given."""
    workers: int = 2
    """Number of processes."""


def run_part(part: tuple[float, DemoConfig, int]) -> DemoResult | None:
    """Simulate one build; None where its skin is too slow to command an arm."""
    try:
        return run_build(*part)
    except ArmError:
        return None


def compute_interval(
    counts: Float[np.ndarray, "build 2"],
) -> tuple[float, float, float]:
    """Return a ratio over builds, and its 95 % interval.

    Args:
        counts: numerator and denominator of each build.
    """
    total, per = resample_clusters(counts, 28).T
    low, high = np.percentile(total / np.maximum(per, 1e-9), [2.5, 97.5])
    total, per = counts.sum(axis=0)
    return float(total / max(per, 1e-9)), float(low), float(high)


def count_outcomes(part: DemoResult) -> Float[np.ndarray, "4 2"]:
    """Return numerators and denominators of a build.

    They are of touches obeyed correctly and wrongly, of unasked stops by accidents,
    and of unasked commands to go on by simulated hours.
    """
    score = part.score
    unasked = part.score.count_unasked()
    attempts = len(score.attempts)
    return np.array(
        [
            (score.count("correct"), attempts),
            (score.count("wrong"), attempts),
            (unasked["unasked_stops"], len(score.accidents)),
            (unasked["unasked_going_on"], part.seconds / 3600.0),
        ],
        dtype=np.float64,
    )


def format_times(times: tuple[float, float] | None) -> str:
    """Format a median and a 95th percentile [s]."""
    return "-" if times is None else f"{times[0]:.2f} / {times[1]:.2f}"


def format_result(name: str, parts: list[DemoResult]) -> str:
    """Format the builds of a condition as a row of the table."""
    result = merge_results(parts)
    by_faults = result.score.by_faults
    counts = np.stack([count_outcomes(part) for part in parts], axis=1)
    *shares, rate = (compute_interval(each) for each in counts)
    obeyed, wrong, stops = ("{:.1%} ({:.0%} to {:.0%})".format(*s) for s in shares)
    return format_row(
        [
            name,
            str(len(result.score.attempts)),
            obeyed,
            wrong,
            str(len(result.score.accidents)),
            stops,
            "{:.1f} ({:.1f} to {:.1f})".format(*rate),
            format_times(result.delay),
            format_times(result.stop_delay),
            f"{result.availability:.1%}",
            str(len(by_faults)),
            str(count_going_on(by_faults)),
            str(result.score.asked),
            str(result.score.answered),
        ]
    )


def main(args: list[str] | None = None) -> None:
    """Print the table, and why touches were lost."""
    command = tyro.cli(Command, args=args)
    lost: dict[str, Counter[str]] = {}
    print(format_head(HEAD), flush=True)
    with get_context("spawn").Pool(command.workers) as pool:
        for name, config in ROWS.items():
            if command.only and not any(part in name for part in command.only):
                continue
            config = replace(config, model=command.model, commands=command.commands)
            plans = [
                (command.seconds, config, command.seed + number)
                for number in range(command.builds)
            ]
            found = list(pool.imap(run_part, plans))
            parts = [part for part in found if part is not None]
            lost[name] = Counter(merge_results(parts).score.count_failures())
            lost[name]["builds that are too slow"] = len(found) - len(parts)
            print(format_result(name, parts), flush=True)
    for name, reasons in lost.items():
        told = ", ".join(f"{n} {why}" for why, n in reasons.most_common() if n)
        print(f"<!-- {name}: {told or 'none'} lost -->")


if __name__ == "__main__":
    main()
