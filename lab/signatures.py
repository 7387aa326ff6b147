"""Test whether the weights recognise a class by an artefact of the simulator.

    python -m lab.signatures --model MODEL --sets SETS

Every constant of the simulation that only some classes have is set almost to zero in
the test clips, with the same weights, people, places and seeds. If a class loses much
recall, its constant needs a measured source, or a correction. The command prints a
table of docs/simulation.md. The clips are those of `--set val` with a seed of their
own; nothing is chosen on them.
"""

import shutil
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import tyro

from eskin.learn.checkpoint import to_network
from eskin.learn.dataset import prepare
from eskin.learn.evaluation import predict_clips
from eskin.live import Model, load_model
from eskin.recording import find_recordings
from eskin.sim.constants import load_constants
from eskin.sim.dataset import GenerationSettings, Simulator, generate

NEARLY_NOTHING = 1e-3
"""Factor that makes a constant almost zero."""

ALLOWED = 0.05
"""Loss of recall above which a class is listed."""

LACKED: dict[str, tuple[str, ...]] = {
    "wander of what a person holds in place": ("hand.wander",),
    "slow noise of a force": ("force.noise",),
    "tremor of a force (not of bodies and things)": ("force.tremor",),
    "ripple of what slides": ("slide.ripple",),
    "ramps of a push": ("push.rise", "push.fall"),
    "ramps of a grab": ("grab.rise", "grab.fall"),
    "ramps of a stroke, a brush, a cable": ("stroke.rise", "stroke.fall"),
    "ramps of a resting hand": ("none.resting_hand.ramp",),
    "pressing again (pokes)": ("poke.again",),
    "way between two pats": ("double_pat.shift",),
    "hand that stays between two pats": ("double_pat.stays",),
    "twist of a grab": ("grab.twist",),
    "fingers that bend one by one (pokes)": ("poke.conformity",),
    "splay of the fingers": ("hand.splay", "grab.splay"),
    "slide of a bump": ("none.bump.slide",),
    "rebound of a bump": ("none.bump.rebound",),
    "sway of guiding hands": ("none.guiding.sway",),
    "film over the taxels (electrical events have none)": ("film.sigma",),
}
"""Constants of each property that only some classes have."""


@dataclass(frozen=True)
class Command:
    """Remove, one by one, properties that only some classes of touches have."""

    model: Path = Path("ur5")
    """Name of weights that come with eskin, or a model file."""
    sets: Path = Path("sets")
    """Folder of the clips, which are removed after each row."""
    clips: int = 500
    """Number of clips of each row, equally many of each class."""
    seed: int = 31
    """Seed of people, places and sensors."""
    workers: int = 2
    """Number of processes that generate and prepare."""


def main() -> None:
    """Print the table."""
    command = tyro.cli(Command)
    model = load_model(command.model)
    names = model.card.vocabulary
    usual = measure_recalls(command, model, ())
    print(f"| almost zero | {' | '.join(names)} | loses more than 5 points |")
    print("|---|" + "---|" * (len(names) + 1))
    print(f"| (as it is) | {' | '.join(f'{each:.1%}' for each in usual)} | |")
    for what, constants in LACKED.items():
        found = measure_recalls(command, model, constants)
        lost = [
            n for n, a, b in zip(names, usual, found, strict=True) if a - b > ALLOWED
        ]
        cells = [f"{b - a:+.1%}" for a, b in zip(usual, found, strict=True)]
        print(f"| {what} | {' | '.join(cells)} | {', '.join(lost)} |", flush=True)


def measure_recalls(
    command: Command, model: Model, constants: tuple[str, ...]
) -> tuple[float, ...]:
    """Return the recall of each class while some constants are almost zero."""
    folder = command.sets / "signature"
    shutil.rmtree(folder, ignore_errors=True)
    settings = GenerationSettings("val", "ur5", command.seed, command.clips)
    generate(folder, settings, command.workers, partial(build_world_without, constants))
    card = model.card
    dataset = prepare(
        find_recordings([folder]),
        pipeline=card.pipeline,
        graph=card.graph_used,
        pack=folder / "pack",
        workers=command.workers,
    )
    found = predict_clips(to_network(model), dataset, card.vocabulary, card.temperature)
    shutil.rmtree(folder)
    right = found.predicted == found.truth
    return tuple(
        float(np.mean(right[found.truth == number]))
        for number in range(len(card.vocabulary))
    )


def build_world_without(constants: tuple[str, ...], skin: str) -> Simulator:
    """Build a simulator with some constants almost zero."""
    factors = {name: NEARLY_NOTHING for name in constants}
    return Simulator(skin, load_constants().scaled(factors))


if __name__ == "__main__":
    main()
