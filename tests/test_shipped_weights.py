"""Floors of the weights that come with eskin, on small sets that their seeds fix.

Weights, front end and simulator decide the figures; nothing was chosen on these sets.
Where a change is meant to move one, its floor moves with it, in the same commit.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.textbook.sweeps import run
from benchmarks.transfer import (
    SETS,
    Group,
    TransferSetting,
    answer_trials,
    compute_results,
    get_required_groups,
    read_trials,
)

from eskin.learn.checkpoint import to_network
from eskin.learn.dataset import prepare
from eskin.learn.evaluation import predict_clips
from eskin.model import load_model
from eskin.sim.dataset import GenerationSettings, Simulator, generate

pytestmark = pytest.mark.slow

SHIPPED = ("ur5", "ur5-sim")
SEED = 41
CLIPS = 75
"""Clips of each set: three builds of 25."""
EACH = 15
"""Touches of each group of SocialTouch."""


@pytest.fixture(scope="module")
def sets(tmp_path_factory) -> dict[str, list[Path]]:
    """Return the recordings of each set, by its name."""
    folder = tmp_path_factory.mktemp("sets")
    made = {}
    for name in ("val", "val-families"):
        settings = GenerationSettings(name, seed=SEED, clips=CLIPS)
        generate(folder / name, settings, 1, Simulator)
        made[name] = sorted((folder / name).rglob("*.mcap"))
    return made


def compute_clip_accuracy(paths: list[Path], name: str, pack: Path) -> float:
    """Return the accuracy of weights on the clips of a set."""
    model = load_model(name)
    card = model.card
    dataset = prepare(paths, card.pipeline, card.graph_used, pack)
    found = predict_clips(to_network(model), dataset, card.vocabulary, card.temperature)
    return float(np.mean(found.predicted == found.truth))


@pytest.mark.parametrize(
    ("name", "chosen", "floor"),
    [
        ("ur5", "val", 0.77),
        ("ur5-sim", "val", 0.77),
        ("ur5", "val-families", 0.65),
        ("ur5-sim", "val-families", 0.65),
    ],
)
def test_simulated_clips(sets, tmp_path_factory, name, chosen, floor):
    pack = tmp_path_factory.getbasetemp() / "pack"
    assert compute_clip_accuracy(sets[chosen], name, pack) >= floor


@pytest.mark.parametrize(("name", "floor"), [("ur5", 0.9), ("ur5-sim", 0.9)])
def test_textbook_touches(name, floor):
    points = [p for p in run(name, 3, 3, SEED, ("force", "duration")) if p.inside]
    assert sum(p.right for p in points) / sum(p.count for p in points) >= floor


@pytest.mark.parametrize(("name", "floor"), [("ur5", 0.88), ("ur5-sim", 0.75)])
def test_real_touches(socialtouch_folder, name, floor):
    public = SETS["socialtouch"]
    public = replace(public, groups=get_required_groups(public))
    model, trials = load_model(name), read_trials(public, socialtouch_folder)
    chosen = [trial for group in public.groups for trial in draw_trials(trials, group)]
    answers = answer_trials(chosen, public, model, TransferSetting(4.0, 40.0, 50.0))
    right = [compute_results(answers, g, model)["forced_right"] for g in public.groups]
    assert np.mean(right) >= floor


def draw_trials(trials, group: Group):
    """Draw the same few trials of a group every time."""
    inside = [trial for trial in trials if trial.gesture in group.gestures]
    order = np.random.default_rng(SEED).permutation(len(inside))[:EACH]
    return [inside[n] for n in order]
