"""Wrong settings and data of a training are refused, each in one line that says why.

Labels that lie beside their touches, and data that a model does not fit, are tested
with the labels and the evaluation.
"""

import json

import pytest

from eskin.errors import RecordingError
from eskin.learn.config import AugmentConfig
from eskin.learn.dataset import map_graphs, prepare
from eskin.learn.ground_truth import INDEX_NAME, read_clips
from eskin.learn.training import TrainConfig
from helpers.learning import label, record
from helpers.refusals import REFUSALS, check_refusal, refusal

CLIP = {
    "file": "a.mcap",
    "start": 0,
    "gesture": "poke",
    "kind": "tip",
    "plan": {"seconds": 2.0},
}
SOFT = {"labels": [label(0.5, 1.5, "soft")], "calibrated": True}
"""Options of a recording whose only gesture is too soft to be felt."""


def setting(config, entry, value):
    """Return the row of a setting that is out of its range."""
    return refusal(
        f"{entry} {value} of {config.__name__}",
        ValueError,
        lambda folder: config(**{entry: value}),
        f"{entry} is {value}; allowed",
    )


def index(line, part):
    """Return the row of a second line of an index of clips that cannot be read."""

    def call(folder):
        text = f"{json.dumps(CLIP)}\n{line}\n"
        (folder / INDEX_NAME).write_text(text, encoding="utf-8")
        read_clips(folder / "a.mcap")

    parts = ("clips.jsonl line 2 is no clip", part, "generate")
    return refusal(f"index {line:.30}", RecordingError, call, *parts)


ROWS = [
    setting(AugmentConfig, "noise", -0.1),
    setting(AugmentConfig, "patch", 1.5),
    setting(AugmentConfig, "lost", -0.1),
    setting(AugmentConfig, "halved", 1.1),
    setting(AugmentConfig, "stretch", float("nan")),
    setting(AugmentConfig, "crop", -1.0),
    setting(TrainConfig, "epochs", 0),
    setting(TrainConfig, "steps", -1),
    setting(TrainConfig, "batch", 0),
    setting(TrainConfig, "encoded", 0),
    setting(TrainConfig, "readings", 0),
    setting(TrainConfig, "workers", 0),
    setting(TrainConfig, "patience", -1),
    setting(TrainConfig, "rate", 0.0),
    setting(TrainConfig, "rate", float("nan")),
    setting(TrainConfig, "decay", -0.1),
    setting(TrainConfig, "decay", float("inf")),
    setting(TrainConfig, "smoothing", 1.5),
    setting(TrainConfig, "validation", 1.0),
    setting(TrainConfig, "validation", -0.1),
    index("{", "Expecting property name"),
    index("[]", "list indices"),
    index("7", "'int' object"),
    index('{"file": "a"}', "'gesture'"),
    index(json.dumps(CLIP | {"start": "soon"}), "'soon'"),
    index(json.dumps(CLIP | {"plan": {}}), "'seconds'"),
    refusal(
        "no recording",
        RecordingError,
        lambda folder: prepare([]),
        "no recording given",
    ),
    refusal(
        "recording without touches",
        RecordingError,
        lambda folder: prepare([record(folder / "a.mcap", (), **SOFT)]),
        "no touch in 1 recording;",
    ),
    refusal(
        "no graphs",
        ValueError,
        lambda folder: map_graphs([], folder),
        "no graphs to join",
    ),
]


@pytest.mark.parametrize(REFUSALS, ROWS)
def test_what_cannot_be_learned_from_is_refused_in_one_line(
    error, call, parts, tmp_path
):
    check_refusal(error, call, parts, tmp_path)
