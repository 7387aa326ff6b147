"""Measure the effect of estimated forces that are half or twice as large."""

import numpy as np

from eskin.sim.constants import Constants, load_constants
from lab.simulation.clips import ClipSummary, Factors, simulate
from lab.simulation.forest import grow, list_labels, stack_features

TEST = "test-s"
FELT = 3.0  # pressure from which a touch is a contact [kPa]


def sweep_table(clips: int, seed: int) -> str:
    """Format the accuracy of a forest on simulations with other forces.

    Args:
        clips: number of clips for training; a third as many for each test.
        seed: seed of clips and forests.
    """
    constants = load_constants()
    level = constants.value("sets.difficulty")
    grown = grow(simulate("train", clips, level, seed), seed)
    rows = [
        "\n**Estimated forces, half and twice as large**\n",
        f"A random forest with 15 features, trained on {clips} clips of `train` and "
        f"tested on {clips // 3} clips of `{TEST}`. Felt: share of gestures that read "
        f"{FELT:g} kPa anywhere.\n",
        "| force of | half: accuracy | half: felt | as published: accuracy | felt | "
        "twice: accuracy | twice: felt |",
        "|---|---|---|---|---|---|---|",
    ]
    plain = simulate(TEST, clips // 3, level, seed)
    for name, factors in worlds(constants):
        half, twice = (
            simulate(TEST, clips // 3, level, seed, factors=times(factors, factor))
            for factor in (0.5, 2.0)
        )
        cells = []
        for made in (half, plain, twice):
            right = grown.predict(stack_features(made)) == list_labels(made)
            cells += [f"{np.mean(right):.1%}", f"{felt(made):.1%}"]
        rows.append(f"| {name} | {' | '.join(cells)} |")
    return "\n".join(rows)


def worlds(constants: Constants) -> list[tuple[str, tuple[str, ...]]]:
    """List every estimated force of a gesture, then all estimated forces together."""
    estimated = tuple(
        name
        for name, entry in constants.entries.items()
        if name.endswith(".force") and entry.unit == "N" and entry.estimate
    )
    single = [(name, (name,)) for name in estimated if name.count(".") == 1]
    return [*single, ("everything", estimated)]


def times(names: tuple[str, ...], factor: float) -> Factors:
    """Return the same factor on some constants."""
    return tuple((name, factor) for name in names)


def felt(made: list[ClipSummary]) -> float:
    """Return the share of gestures that reach `FELT`."""
    return float(np.mean([each.peak >= FELT for each in made if each.label != "none"]))
