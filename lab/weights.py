"""Make weights that come with eskin: generate the sets, then train.

    python -m lab.weights --sets SETS --out FOLDER
    python -m lab.weights --sets SETS --out FOLDER --weights p0 p1

`ur5-sim` is trained on simulated people alone. `ur5-first` is trained on from it, with
touches of the people of SocialTouch, random devices that simulated people, those of
SocialTouch and four of CapFingerId touch, and many kinds of `none` beside some of the
same sets. `ur5` is trained on from `ur5-first` with the same, more slowly. `p0` and
`p1` are trained like `ur5-first` with one person of SocialTouch each, so that `python
-m lab.transfer --people P1 --model FOLDER/p0.safetensors` tests on the other one.
`ur5-groups` knows the 12 groups of gestures of SocialTouch instead of the
classes of the paper, and starts from `ur5-sim`; `groups-p0` and `groups-p1` are trained
on one person each (`lab.transfer socialtouch-groups`). The decision of `ur5` and of
those like it is `DECISION`, that of the others the default. Sets and prepared
recordings that exist are used as they are.
"""

import subprocess
import sys
from dataclasses import dataclass, replace
from pathlib import Path

import tyro

from eskin.live import load_model

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


AGAIN = {
    "train": SIMULATED["train"],
    "again-families": "--set train-families --clips 6000",
    "again-sparse": "--set train-families --seed 2 --skin ur5-sparse --clips 1200",
    "again-dense": "--set train-families --seed 3 --skin ur5-dense --clips 1000",
    "train-moving": SIMULATED["train-moving"],
    "train-pairs": SIMULATED["train-pairs"],
}
"""Part of these sets, for weights for all sensors: they start from weights that know
all of them."""

DEVICES = {"devices": "--set devices --seed 1 --clips 8000 --subjects 1000"}
"""Sets of random devices that simulated people touch; those of recorded people come
with `build_recorded_sets`."""

NON_GESTURES = {
    "none": "--set non-gestures --seed 1 --clips 5000",
    "none-dense": "--set non-gestures --seed 2 --skin ur5-dense --clips 1000",
}
"""Sets of clips that are all `none`, of many kinds."""

PHONE = (1, 3, 6, 8)
"""People of CapFingerId to train on; the others of its folder are for tests."""

VALIDATION = {
    "tuneval": "--set val --clips 400",
    "tunefam": "--set val-families --clips 600",
}
"""Sets that epoch and temperature are chosen on."""

VALIDATION_EVERYWHERE = {
    "tunedev": "--set devices --seed 11 --clips 750",
    "tunenone": "--set non-gestures --seed 11 --clips 300",
}
"""Sets that epoch and temperature of weights for all sensors are chosen on too."""


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
    grouped: bool = False
    """Whether classes are the groups of gestures of SocialTouch."""
    everywhere: bool = False
    """Whether it is trained on random devices and more kinds of `none` as well."""
    rate: float = 0.003
    """Highest learning rate of the cycle."""


WEIGHTS = {
    "ur5-sim": Recipe("", (), 20, 250),
    "ur5-first": Recipe("ur5-sim", (0, 1), 12, 250, everywhere=True),
    "ur5": Recipe("ur5-first", (0, 1), 18, 250, everywhere=True, rate=0.002),
    "p0": Recipe("ur5-sim", (0,), 12, 250, everywhere=True),
    "p1": Recipe("ur5-sim", (1,), 12, 250, everywhere=True),
    "ur5-groups": Recipe("ur5-sim", (0, 1), 8, 250, grouped=True),
    "groups-p0": Recipe("ur5-sim", (0,), 8, 250, grouped=True),
    "groups-p1": Recipe("ur5-sim", (1,), 8, 250, grouped=True),
}
"""Recipes by the name of the weights."""

OPTIONS = """
--skins 0 --train.batch 96 --train.encoded 32 --train.readings 10 --train.decay 0.1
--train.smoothing 0.05 --train.patience 99 --train.ridge 0.1 --train.network.dropout 0.1
--train.augment.gain 0.9 --train.augment.taxel-gain 0.05 --train.augment.dead 0.03
--train.augment.offset 0.25 --train.augment.crop 0 --train.augment.stretch 0.1
--train.augment.lost 0.3 --train.augment.halved 0.1 --train.augment.patch 0.05
--train.augment.noise 0.02
--train.network.width 32 --train.network.layers 3 --train.network.channels 48
--train.shares recorded
""".split()
"""Options of every training; after a set of `shares` follows its share of the windows
of a class."""

SHARES = ("0.5",)
"""Share of recorded people."""

SHARES_EVERYWHERE = ("0.25", "devices", "0.35", "non-gestures", "0.25")
"""Shares of recorded people and of random devices, and, in the windows of `none`, of
the sets of many kinds of it."""

DECISION = {
    "threshold": 0.95,
    "dwell_seconds": 0.0,
    "least": 0.5,
    "deliberate": 0.75,
    "thresholds": {"double_pat": 0.98, "poke": 0.98},
}
"""What the decision of `ur5` has instead of the default."""


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
    weights: tuple[str, ...] = ("ur5-sim", "ur5-first", "ur5")
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
                f"--weights has '{unknown[0]}'; allowed are {', '.join(WEIGHTS)}"
            )


def main() -> None:
    """Generate missing sets, and train."""
    command = tyro.cli(Command)
    command.out.mkdir(parents=True, exist_ok=True)
    for name in command.weights:
        train(name, command)


def train(name: str, command: Command) -> None:
    """Train weights on their sets."""
    recipe = WEIGHTS[name]
    trained = build_recorded_sets(recipe, command.socialtouch)
    validation = {} if recipe.grouped else VALIDATION
    shares = SHARES
    if not recipe.grouped:
        trained = (AGAIN if recipe.everywhere else SIMULATED) | trained
    if recipe.everywhere:
        shares = SHARES_EVERYWHERE
        trained |= DEVICES | build_device_sets(recipe, command) | NON_GESTURES
        validation = validation | VALIDATION_EVERYWHERE
    for sets in (trained, validation):
        for folder, options in sets.items():
            generate(command.sets / folder, options.split(), command.workers)
    chosen: list[str] = []
    if validation:
        chosen = ["--val", *(str(command.sets / each) for each in validation)]
    start = command.out / f"{recipe.start}.safetensors"
    path = command.out / f"{name}.safetensors"
    run(
        "train",
        *(str(command.sets / folder) for folder in trained),
        "--pack",
        str(command.sets / "pack"),
        "--out",
        str(path),
        "--train.epochs",
        str(recipe.epochs),
        "--train.steps",
        str(recipe.steps),
        "--train.workers",
        str(command.workers),
        "--train.rate",
        str(recipe.rate),
        "--seed",
        str(command.seed),
        *OPTIONS,
        *shares,
        *(["--start", str(start)] if recipe.start else []),
        *chosen,
    )
    if recipe.everywhere:
        set_decision(path)


def set_decision(path: Path) -> None:
    """Write the decision of weights for all sensors into their file."""
    model = load_model(path)
    decision = replace(model.card.decision, **DECISION)
    replace(model, card=replace(model.card, decision=decision)).save(path)


def build_recorded_sets(recipe: Recipe, source: Path) -> dict[str, str]:
    """Return the sets of recorded people, by folder, with their options."""
    kind = "recorded"
    folder = "rec"
    if recipe.grouped:
        kind = "recorded-groups"
        folder = "groups"
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
