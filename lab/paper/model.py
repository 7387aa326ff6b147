"""Train the paper's network for the live system, and write its model file.

    python -m lab.paper.model --sets SETS --out plugins/paper_network/ur5.safetensors

It learns from a set as large as the paper's that has the class `none` as well, which a
live recogniser needs.
"""

import sys
from dataclasses import dataclass
from pathlib import Path

from eskin_paper_network import PaperNetwork
from eskin_paper_network.model import save_paper_model

from lab.baselines import PaperBaseline
from lab.baselines.network import use_one_thread
from lab.comparison.examples import find_examples
from lab.comparison.methods import FIT_CONFIGS
from lab.program import run_program
from lab.simulated_sets import made_set

NEIGHBOURS = 8
STRIDE = 4


@dataclass(frozen=True)
class ModelCommand:
    """Train the paper's network for the live system, and write its model file."""

    out: Path
    """Model file to write (.safetensors)."""

    sets: Path = Path("sets")
    """Folder of the sets."""

    clips: int | None = None
    """Number of clips; as in the paper's set unless given."""

    workers: int = 1
    """Number of processes that make the set."""


def train(command: ModelCommand) -> dict[str, object]:
    """Train the network, write its model file, and return its accuracies."""
    use_one_thread()
    folder = made_set(
        command.sets, "paper-5", clips=command.clips, workers=command.workers
    )
    pack = command.sets / "pack"
    clips = find_examples([folder / "train"], pack, command.workers)
    test = find_examples([folder / "test"], pack, command.workers)
    gestures = clips.gestures
    baseline = PaperBaseline(
        clips.mounted, FIT_CONFIGS["paper"], NEIGHBOURS, "max", stride=STRIDE
    )
    baseline.fit(clips.windows, clips.truth(gestures))
    answers = baseline.predict_probabilities(test.windows).argmax(axis=1)
    accuracy = float((answers == test.truth(gestures)).mean())
    metrics = {"held_out_accuracy": max(baseline.history)[0], "test_accuracy": accuracy}
    assert isinstance(baseline.network, PaperNetwork)
    save_paper_model(command.out, baseline.network, gestures, metrics=metrics)
    print(f"{command.out}: {accuracy:.1%} of {test.count} test clips")
    return {"out": str(command.out), **metrics}


if __name__ == "__main__":
    sys.exit(run_program(train))
