"""Who is answered for was never learned from."""

import itertools
import json
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest

from helpers.learning import AS_RECORDED, TINY, label, onset, record_people
from lab.baselines import NETWORKS, FitConfig, PaperBaseline
from lab.baselines.estimators import RandomForest
from lab.baselines.hand import HandBaseline
from lab.compare import CompareCommand, run_compare
from lab.comparison.methods import (
    METHODS_ON_RECORDINGS,
    BaselineMethod,
    Method,
    RecogniserMethod,
    TouchMethod,
)
from lab.program import run_program
from lab.real_recordings import RealCommand, run_real

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("few_windows")]

PEOPLE = ("ann", "bob", "cleo")
FOUR = ("hold", "tap", "tap", "hold")
LEARNED = replace(
    TINY,
    steps=25,
    batch=16,
    encoded=16,
    rate=2e-2,
    decay=0.0,
    smoothing=0.0,
    validation=0.0,
    augment=replace(AS_RECORDED, crop=0.5),
)
FEW_EPOCHS = FitConfig(epochs=8, batch=4, rate=5e-3)
CHEAP = ("svm-features", "knn-features", "minirocket", "svm-bins", "lda-max")
TINY_METHODS: dict[str, Method] = METHODS_ON_RECORDINGS | {
    "eskin": RecogniserMethod(LEARNED, small=None),
    "paper": BaselineMethod(
        partial(PaperBaseline, config=FEW_EPOCHS, k=4, pooling="max")
    ),
    **{
        name: BaselineMethod(partial(NETWORKS[name], config=FEW_EPOCHS))
        for name in ("cnn-lstm", "3d-cnn", "tactile-image")
    },
    "random-forest": BaselineMethod(
        partial(HandBaseline, estimator=RandomForest(trees=10))
    ),
    "random-forest-features": TouchMethod(RandomForest(trees=10), ("features",)),
}
UNSUITED = ("boosting-on-touch", "gradient-boosting", "gradient-boosting-features")
"""Boosted trees need more examples in a leaf than there are."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("people")
    record_people(folder / "people", PEOPLE, gestures=FOUR)
    return folder


def compare(folder, results, methods, chosen, **options):
    """Compare methods on the people of a folder; return the rows by method."""
    command = CompareCommand(
        recordings=(folder / "people",),
        methods=tuple(chosen),
        results=results,
        pack=folder / "pack",
        **options,
    )
    rows = run_compare(command, methods)["rows"]
    return {row["name"]: row for row in rows}


@dataclass(frozen=True)
class Spy(Method):
    """Logs who is trained on and who is answered for."""

    log: str

    def fit(self, examples, seed):
        trained = sorted(set(examples.groups))

        def predict(other):
            line = json.dumps([trained, sorted(set(other.groups))])
            with open(self.log, "a") as file:
                file.write(f"{line}\n")
            return np.tile([1.0, 0.0], (other.count, 1))

        return predict


def test_no_fold_trains_on_the_person_that_it_answers_for(folder, tmp_path):
    log = tmp_path / "log"
    methods = {"eskin": Spy(str(log))}
    rows = compare(folder, tmp_path / "results", methods, methods)
    lines = [json.loads(line) for line in log.read_text().splitlines()]
    assert [held for _, held in lines] == [[person] for person in PEOPLE]
    for trained, (held,) in lines:
        assert set(trained) == set(PEOPLE) - {held}
    row = rows["eskin"]
    assert (row["test_clips"], row["test_people"]) == (12, 3)
    assert row["by_group"] == dict.fromkeys(PEOPLE, 0.5)
    assert row["by_gesture"] == {"hold": 1.0, "tap": 0.0}


@pytest.mark.parametrize("name", sorted(set(TINY_METHODS) - set(UNSUITED)))
def test_clearly_different_gestures_are_recognised_on_held_out_people(
    name, folder, tmp_path
):
    rows = compare(folder, tmp_path / "results", TINY_METHODS, [name])
    assert rows[name]["test_accuracy"] >= 0.75


def test_shuffled_labels_are_not_recognised_better_than_by_chance(tmp_path):
    rng = np.random.default_rng(5)
    for person in PEOPLE:
        names = rng.permutation(FOUR).tolist()
        pairs = enumerate(names)
        labels = [label(onset(n), onset(n) + 1.2, name) for n, name in pairs]
        record_people(tmp_path / "people", (person,), gestures=FOUR, labels=labels)
    rows = compare(tmp_path, tmp_path / "results", TINY_METHODS, CHEAP)
    for name, row in rows.items():
        assert row["test_accuracy"] < 0.85, name


def test_answers_are_kept_and_a_method_with_folds_left_has_no_row(
    folder, tmp_path, capsys
):
    kept = tmp_path / "results"
    chosen = ("knn-max", "lda-max")
    rows = compare(folder, kept, None, chosen)
    assert compare(folder, kept, None, chosen, minutes=-1) == rows
    lines = kept.read_text().splitlines()
    kept.write_text("".join(f"{line}\n" for line in lines[:-1]))
    capsys.readouterr()
    assert list(compare(folder, kept, None, chosen, minutes=-1)) == ["knn-max"]
    out = capsys.readouterr().out
    assert "1 of 6 trainings are left; the same command goes on" in out
    assert "Tested on 12 segments of 3 people, intervals over segments." in out
    assert "| people | ann | bob | cleo |" in out


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--methods", "timers"], "--methods names timers; allowed are eskin, "),
        (["--train", "x"], "--recordings names 1, --train 1 and --test 0; allowed are"),
        (
            ["--rename", "kick", "tap"],
            "no gesture kick to rename; allowed are hold, ta",
        ),
        (["--hold-out", "day"], "--hold-out"),
        (["--seeds", "0"], "seeds is 0; allowed is from 1"),
    ],
)
def test_bad_options_of_recordings_are_refused(
    folder, tmp_path, capsys, words, message
):
    command = ["--recordings", folder / "people", "--results", tmp_path / "r"]
    command += ["--pack", folder / "pack", *words]
    code = run_program(run_compare, list(map(str, command)))
    out, err = capsys.readouterr()
    assert code == 2 and err.count("\n") == 1 and message in err


def test_a_public_set_is_converted_and_compared_with_each_person_held_out(
    tmp_path, capsys
):
    lines = ["subject,variant,gesture,frame," + ",".join(f"ch{n}" for n in range(64))]
    for person, gesture in itertools.product((1, 2), (6, 12) * 3):
        for frame in range(70):
            row = np.zeros(64, int)
            if 15 < frame < 50:
                row[27 if gesture == 6 else 24 + frame // 10] = 700
            lines.append(",".join(map(str, (person, 1, gesture, frame, *row))))
    (tmp_path / "CoST.csv").write_text("\n".join(lines))
    command = RealCommand(
        "cost", tmp_path / "CoST.csv", tmp_path / "work", methods=CHEAP
    )
    found = run_real(command)
    assert list(found) == ["Segments"]
    out = capsys.readouterr().out
    assert "Tested on 12 segments of 2 people, intervals over segments." in out
    assert all(f"| {name} |" in out for name in CHEAP)
    assert (tmp_path / "work/kept/cost-segments.jsonl").exists()
