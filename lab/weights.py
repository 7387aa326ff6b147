"""Make weights that come with eskin: generate the sets, then train.

    python -m lab.weights --sets SETS --out FOLDER
    python -m lab.weights --sets SETS --out FOLDER --weights p0 p1

`ur5-sim` is trained on simulated people alone. `ur5-people` is trained on from
`ur5-sim`, with touches of the people of SocialTouch beside the same sets, and `ur5`
from `ur5-people`, with random devices as well, touched by simulated people, those of
SocialTouch and four of CapFingerId; then it is averaged with `ur5-people`. `p0` and
`p1` are trained on with one person of SocialTouch each, so that `python -m lab.transfer
--people P1 --model FOLDER/p0.safetensors` tests on the other one. `ur5-groups` knows
the 12 groups of gestures of SocialTouch instead of the classes of the paper, and starts
from `ur5-sim`; `groups-p0` and `groups-p1` are trained on one person each
(`lab.transfer socialtouch-groups`). The decision of `ur5-people` is chosen on streams,
that of `ur5` is `DECISION`, that of the others the default. Sets and prepared
recordings that exist are used as they are.
"""

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import tyro

from eskin.live import load_model, save_model

SIMULATED = {
    "train": "--set train --clips 5000",
    "train-families": "--set train-families --clips 16000",
    "train-sparse": "--set train-families --seed 2 --skin ur5-sparse --clips 2400",
    "train-dense": "--set train-families --seed 3 --skin ur5-dense --clips 2000",
    "train-post": "--set train-families --seed 4 --skin post --clips 1000",
    "train-moving": "--set train-moving --clips 3000",
    "train-pairs": "--set pairs --seed 1 --clips 500",
}
"""Sets of simulated people to train on, by their folder, with the options of `eskin
generate`."""


DEVICES = {"devices": "--set devices --seed 1 --clips 3500 --subjects 60"}
"""Sets of random devices that simulated people touch; those of recorded people come
with `build_recorded_sets`."""

PHONE = (1, 3, 6, 8)
"""People of CapFingerId to train on; the others of its folder are for tests."""

VALIDATION = {
    "tuneval": "--set val --clips 400",
    "tunefam": "--set val-families --clips 600",
}
"""Sets that epoch and temperature are chosen on."""

VALIDATION_DEVICES = {"tunedev": "--set devices --seed 11 --clips 750"}
"""Set that epoch and temperature of weights for devices are chosen on too."""

STREAMS = {
    "tunestreams": "--set streams-fresh --seed 1 --clips 8",
    "tunestreamsx": "--set streams --seed 1 --clips 8",
    "tunestreamsf": "--set streams-families --seed 1 --clips 12",
}
"""Sets that the decision is chosen on."""


@dataclass(frozen=True)
class Recipe:
    """A recipe says how weights are trained."""

    start: str
    """Weights to start from; empty for random ones."""
    people: tuple[int, ...]
    """People of SocialTouch to train on."""
    epochs: int
    steps: int
    """Steps of an epoch."""
    decides: bool = False
    """Whether the decision is chosen on streams."""
    grouped: bool = False
    """Whether classes are the groups of gestures of SocialTouch."""
    devices: bool = False
    """Whether it is trained on random devices as well."""


WEIGHTS = {
    "ur5-sim": Recipe("", (), 20, 250),
    "ur5-people": Recipe("ur5-sim", (0, 1), 8, 250, decides=True),
    "ur5": Recipe("ur5-people", (0, 1), 8, 200, devices=True),
    "p0": Recipe("ur5-sim", (0,), 8, 200),
    "p1": Recipe("ur5-sim", (1,), 8, 200),
    "ur5-groups": Recipe("ur5-sim", (0, 1), 8, 250, grouped=True),
    "groups-p0": Recipe("ur5-sim", (0,), 8, 250, grouped=True),
    "groups-p1": Recipe("ur5-sim", (1,), 8, 250, grouped=True),
}
"""Recipes by the name of the weights."""

OPTIONS = """
--skins 0 --train.batch 96 --train.encoded 32 --train.readings 10 --train.decay 0.1
--train.smoothing 0.05 --train.patience 99 --train.ridge 0 --train.network.dropout 0.1
--train.augment.gain 0.9 --train.augment.taxel-gain 0.05 --train.augment.dead 0.03
--train.augment.offset 0.25 --train.augment.crop 0 --train.augment.stretch 0.1
--train.augment.lost 0.3 --train.augment.halved 0.1 --train.augment.patch 0.05
--train.augment.noise 0.02
--train.network.width 32 --train.network.layers 3 --train.network.channels 48
--train.shares recorded
""".split()
"""Options of every training; after a set of `shares` follows its share of the windows
of a class."""

SHARES, DEVICE_SHARES = ("0.5",), ("0.3", "devices", "0.25")
"""Shares of recorded people without and with devices."""

KEPT = 0.2
"""Weight of the weights that training on devices starts from in the mean that is
shipped: much of what devices teach, and most of what was known before, is in it."""

DECISION = {
    "least": 0.5,
    "deliberate": 0.75,
    "thresholds": {"double_pat": 0.98, "poke": 0.98},
}
"""What the decision of `ur5` has instead of that of `ur5-people`."""


@dataclass(frozen=True)
class Command:
    """Make the weights that come with eskin."""

    sets: Path
    """Folder of the sets, and of the prepared recordings."""
    out: Path
    """Folder of the weights."""
    socialtouch: Path = Path("../shared/data/socialtouch")
    """Folder of the SocialTouch set, as published."""
    phone: Path = Path("../shared/data/capfingerid")
    """Folder of the CapFingerId set, one file a person."""
    weights: tuple[str, ...] = ("ur5-sim", "ur5-people", "ur5")
    """Names of the weights to make, those to start from first."""
    seed: int = 0
    """Seed of the training."""
    workers: int = 2
    """Number of processes that generate and prepare, and of threads that train."""

    def __post_init__(self) -> None:
        """Raise if weights have no known name."""
        unknown = [name for name in self.weights if name not in WEIGHTS]
        if unknown:
            raise ValueError(
                f"--weights has '{unknown[0]}'; allowed are {', '.join(WEIGHTS)}; take "
                "those"
            )


def main() -> None:
    """Generate what is missing, and train."""
    command = tyro.cli(Command)
    command.out.mkdir(parents=True, exist_ok=True)
    for name in command.weights:
        train(name, command)


def train(name: str, command: Command) -> None:
    """Train weights on their sets."""
    recipe = WEIGHTS[name]
    trained = build_recorded_sets(recipe, command.socialtouch)
    validation = {} if recipe.grouped else VALIDATION
    streams = STREAMS if recipe.decides else {}
    if not recipe.grouped:
        trained = SIMULATED | trained
    if recipe.devices:
        trained |= DEVICES | build_device_sets(recipe, command)
        validation = validation | VALIDATION_DEVICES
    for sets in (trained, validation, streams):
        for folder, options in sets.items():
            generate(command.sets / folder, options.split(), command.workers)
    chosen: list[str] = []
    for option, sets in (("--val", validation), ("--streams", streams)):
        chosen += [option, *(str(command.sets / each) for each in sets)] if sets else []
    start = command.out / f"{recipe.start}.safetensors"
    run(
        "train",
        *(str(command.sets / folder) for folder in trained),
        *("--pack", str(command.sets / "pack")),
        *("--out", str(command.out / f"{name}.safetensors")),
        *("--train.epochs", str(recipe.epochs), "--train.steps", str(recipe.steps)),
        *("--train.workers", str(command.workers)),
        *("--seed", str(command.seed)),
        *(*OPTIONS, *(DEVICE_SHARES if recipe.devices else SHARES)),
        *(["--start", str(start)] if recipe.start else []),
        *chosen,
    )
    if recipe.devices:
        average_weights(start, command.out / f"{name}.safetensors")


def average_weights(start: Path, path: Path) -> None:
    """Average weights with those that their training started from."""
    earlier, later = load_model(start), load_model(path)
    weights = {
        name: (KEPT * earlier.weights[name] + (1.0 - KEPT) * each).astype(np.float32)
        for name, each in later.weights.items()
    }
    decision = replace(earlier.card.decision, **DECISION)
    training = later.card.training | {"kept": str(KEPT)}
    card = replace(later.card, decision=decision, training=training, metrics={})
    save_model(path, replace(later, weights=weights, card=card))


def build_recorded_sets(recipe: Recipe, source: Path) -> dict[str, str]:
    """Return the sets of recorded people, by folder, with their options."""
    kind, folder = "recorded", "rec"
    if recipe.grouped:
        kind, folder = "recorded-groups", "groups"
    sets = {}
    for person in recipe.people:
        options = f"--set {kind} --recorded {source} --people {person}"
        dense = f"{options} --skin ur5-dense --seed 1 --clips 1200"
        sets |= {
            f"{folder}{person}": f"{options} --clips 2400",
            f"{folder}{person}-dense": dense,
        }
    return sets


def build_device_sets(recipe: Recipe, command: Command) -> dict[str, str]:
    """Return the sets of devices that recorded people touch; see the other sets."""
    numbers = " ".join(map(str, PHONE))
    phone = f"--recorded {command.phone} --people {numbers} --seed 4 --clips 1500"
    sets = {"devices-phone": f"--set devices {phone}"}
    for person in recipe.people:
        options = f"--recorded {command.socialtouch} --people {person}"
        sets[f"devices{person}"] = (
            f"--set devices {options} --seed {2 + person} --clips 1000"
        )
    return sets


def generate(folder: Path, options: list[str], workers: int) -> None:
    """Generate a set, or continue one that is not complete."""
    run("generate", str(folder), *options, "--workers", str(workers))


def run(*words: str) -> None:
    """Run an eskin command.

    Raises:
        subprocess.CalledProcessError: it fails.
    """
    script = Path(sys.executable).with_name("eskin")
    subprocess.run([str(script), *words], check=True)


if __name__ == "__main__":
    main()
