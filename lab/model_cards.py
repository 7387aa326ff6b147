"""Describe the weights that come with eskin: a page each, made from its file.

python -m lab.model_cards prints them. The build of the documentation runs `on_files`,
so that no page is kept that a file no longer agrees with.
"""

import sys
from importlib import resources
from pathlib import Path
from typing import Any

# The build of the documentation runs this file by its path.
sys.path.insert(0, str(Path(__file__).parents[1]))

from eskin.live import MODELS, Model, load_model  # noqa: E402
from eskin.units import format_count  # noqa: E402
from lab.tables import format_head, format_row  # noqa: E402
from lab.weights import (  # noqa: E402
    AGAIN,
    DEVICES,
    NON_GESTURES,
    PHONE,
    SIMULATED,
    VALIDATION,
    VALIDATION_EVERYWHERE,
    WEIGHTS,
    Recipe,
)

PEOPLE = "SocialTouch, a pad under a person's hands"
METRICS = {
    "val_accuracy": "accuracy on the validation sets",
    "streams_f1": "F1 of events on the streams that the decision was chosen on",
}
"""Words for the metrics of a card."""


def on_files(files: Any, config: Any) -> Any:  # noqa: ANN401
    """Add the pages to the files of the documentation."""
    from mkdocs.structure.files import File

    for name in MODELS:
        path = f"models/{name}.md"
        files.append(File.generated(config, path, content=describe(name)))
    return files


def describe(name: str) -> str:
    """Return the page of weights."""
    model = load_model(name)
    card = model.card
    recipe = WEIGHTS.get(name)
    path = resources.files("eskin.live") / "presets" / f"{name}.safetensors"
    size = len(path.read_bytes()) / 1e6
    start = card.training.get("start", "")
    own = {METRICS.get(key, key): f"{value:.3f}" for key, value in card.metrics.items()}
    facts = {
        "classes": ", ".join(card.vocabulary),
        "skin": f"any of taxels that measure {card.kind}",
        "file": f"{size:.2f} MB; digest of the weights `{model.digest}`",
        "network": describe_network(model),
        "licence": "Apache-2.0",
    }
    training = {key: value for key, value in sorted(card.training.items())}
    parts = [
        f"# Weights {name}",
        format_pairs(facts),
        f"## Data and people\n\n{describe_data(recipe, start)}",
        "The recordings trained on have the digest "
        f"`{card.data_digest or 'unknown'}`. Sensors are those of the simulator, which "
        "draws gain, dead taxels, offsets, hysteresis and noise of each build anew.",
        "## Accuracy\n\nChosen on, and so somewhat optimistic:",
        format_pairs(own),
        "On sets of people, sensors and poses that nothing was chosen on, with "
        "intervals: [results](../results.md).",
        "## Operating point\n\n" + describe_decision(model),
        "`python -m lab.curve --model " + name + "` draws missed gestures by "
        "accidents an hour, by family of sensors; `eskin evaluate --curve` does so "
        "for recordings of your own.",
        "## Limits\n\nPeople, builds and sensors that differ from these are recognised "
        "less well, and accidental touches are sometimes taken for gestures. It is "
        "[no safety function](../safety.md).",
        "## How it is made\n\n" + describe_command(name, recipe),
        format_pairs(training),
    ]
    return "\n\n".join(parts) + "\n"


def format_pairs(pairs: dict[str, str]) -> str:
    """Format names with their values as a table."""
    rows = [format_row([name, value]) for name, value in pairs.items()]
    return (
        "\n".join([format_head(("", "")), *rows]) if rows else "None are in the file."
    )


def describe_network(model: Model) -> str:
    """Describe the size of the network."""
    size = model.card.network
    count = sum(array.size for array in model.weights.values())
    layers = format_count(size.layers, "equivariant layer")
    window = 0.02 * size.slots
    return (
        f"{count:,} weights; {layers} of width {size.width}, a window of {window:g} s"
    )


def describe_data(recipe: Recipe | None, start: str) -> str:
    """Describe what weights were trained on."""
    if recipe is None:
        return "Simulated people; the recipe is not kept any more."
    rows = [format_head(("set", "options of `eskin generate`"))]
    sets = SIMULATED
    validation = VALIDATION
    if recipe.everywhere:
        sets = AGAIN | DEVICES | NON_GESTURES
        validation = VALIDATION | VALIDATION_EVERYWHERE
    rows += [format_row([name, f"`{text}`"]) for name, text in sets.items()]
    text = "Simulated people:\n\n" + "\n".join(rows)
    if recipe.people:
        names = " and ".join(f"P{number}" for number in recipe.people)
        text += f"\n\nBeside them, touches of {names} of {PEOPLE}."
    if recipe.everywhere:
        text += f" The same people, and {len(PHONE)} of CapFingerId, touch devices too."
    if start:
        text += f"\n\nTraining started from the weights `{start}`."
    chosen = ", ".join(f"`{each}`" for each in validation.values())
    return text + f"\n\nEpoch and temperature were chosen on {chosen}."


def describe_decision(model: Model) -> str:
    """Describe when a gesture is reported."""
    card = model.card
    decision = card.decision
    own = [f"{value:g} for {name}" for name, value in decision.thresholds.items()]
    return (
        f"A gesture is reported while its touch goes on from a probability of "
        f"{decision.threshold:g} ({', '.join(own) or 'all gestures'}), held for "
        f"{decision.dwell_seconds:g} s; a touch that closes below {decision.least:g} "
        f"is `unknown`. Logits are divided by {card.temperature:.3f}."
    )


def describe_command(name: str, recipe: Recipe | None) -> str:
    """Return the command that makes weights."""
    if recipe is None:
        return "The settings of the training, as `eskin train` takes them:"
    return (
        f"`python -m lab.weights --sets SETS --out FOLDER --weights {name}`, with the "
        "settings:"
    )


if __name__ == "__main__":
    print("\n\n".join(map(describe, MODELS)))
