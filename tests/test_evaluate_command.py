"""`eskin evaluate`, as it is called."""

import json
import re

import numpy as np
import pytest

from eskin.cli.evaluate import by_person
from eskin.cli.main import run
from eskin.model import save_model
from learn_scenes import record, record_people
from live_scenes import model_of, network

VOCABULARY = ("none", "hold", "tap")


def call(capsys, *argv):
    code = run(["evaluate", *(str(word) for word in argv)])
    out, err = capsys.readouterr()
    return code, out, err


def last_json(out):
    return json.loads(out.strip().splitlines()[-1])


def model_for(vocabulary=VOCABULARY, kind="pressure"):
    net = network(kind, vocabulary=vocabulary, width=4, layers=1, channels=8)
    return model_of(net, vocabulary)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    record_people(folder, ("ann", "bob"))
    return folder


@pytest.fixture
def model(tmp_path):
    save_model(tmp_path / "m.safetensors", model_for())
    return tmp_path / "m.safetensors"


def test_evaluate_says_how_well_the_model_does(model, data, capsys):
    code, out, err = call(capsys, model, data, "--json")
    assert (code, err) == (0, "")
    result = last_json(out)
    keys = ["accuracy", "macro_f1", "per_class", "per_subject", "ece", "instants"]
    assert list(result) == keys
    assert set(result["per_class"]) == set(VOCABULARY)
    for scores in result["per_class"].values():
        assert set(scores) == {"precision", "recall", "f1", "count"}
    people = [result["per_subject"][name] for name in ("ann", "bob")]
    assert result["per_subject"] == {
        "ann": people[0],
        "bob": people[1],
        "mean": pytest.approx(np.mean(people), abs=1e-4),
        "sd": pytest.approx(np.std(people, ddof=1), abs=1e-4),
        "worst": min(people),
    }
    assert set(result["instants"]) == {"accuracy", "macro_f1"}
    values = [result[key] for key in ("accuracy", "macro_f1", "ece")]
    assert all(0 <= value <= 1 for value in values)
    assert f"segments: accuracy {result['accuracy']:.3f}" in out
    assert "hold" in out and "ann" in out


def test_a_person_called_like_a_score_keeps_both_apart():
    found = by_person({"mean": 0.5, "ann": 0.7})
    three = {"mean": 0.6, "sd": pytest.approx(0.1414), "worst": 0.5}
    assert found == {"person mean": 0.5, "ann": 0.7, **three}
    assert by_person({"ann": 0.7}) == {"ann": 0.7, "mean": 0.7, "sd": 0.0, "worst": 0.7}


def test_recordings_may_be_given_one_by_one_in_any_order(model, data, capsys):
    a, b = sorted(data.iterdir())
    whole = last_json(call(capsys, model, data, "--json")[1])
    assert last_json(call(capsys, model, b, a, "--json")[1]) == whole


def test_the_confusions_are_drawn_where_asked(model, data, tmp_path, capsys):
    picture = tmp_path / "made" / "a.png"
    code, _, _ = call(capsys, model, data, "--picture", picture)
    assert code == 0
    assert picture.read_bytes().startswith(b"\x89PNG")


def test_a_recording_cut_in_half_is_scored_up_to_the_cut_and_named(
    model, data, tmp_path, capsys
):
    half = tmp_path / "half.mcap"
    whole = (data / "ann.mcap").read_bytes()
    half.write_bytes(whole[: len(whole) * 3 // 4])
    code, out, err = call(capsys, model, half, "--json")
    assert (code, err) == (0, "")
    assert "half.mcap is cut or damaged: used up to there" in re.sub(r"\s+", " ", out)
    counts = [row["count"] for row in last_json(out)["per_class"].values()]
    assert 0 < sum(counts) <= 2


def test_bad_input_is_one_line_and_leaves_nothing(model, data, tmp_path, capsys):
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(model.read_bytes()[:200])
    shear, other, wrong = (tmp_path / name for name in ("shear", "other", "wrong"))
    save_model(shear, model_for(kind="shear"))
    save_model(other, model_for(("none", "hold", "grab")))
    four = model_of(model_net := network(vocabulary=VOCABULARY), (*VOCABULARY, "wave"))
    assert not model_net.shear
    save_model(wrong, four)
    start = tmp_path / "start.mcap"
    start.write_bytes((data / "ann.mcap").read_bytes()[:200])
    silent = record(tmp_path / "silent.mcap", labels=[])
    files = set(tmp_path.rglob("*"))
    for argv, message in (
        ((model, tmp_path / "gone"), "no recording at"),
        ((tmp_path / "gone", data), "no such model; train one"),
        ((damaged, data), "is no model file"),
        ((data / "ann.mcap", data), "is no model file"),
        ((model, model), "give a recording made by eskin"),
        ((shear, data), "needs shear, which these recordings do not have"),
        ((other, data), "hold tap, which the model does not know; it knows none, hold"),
        ((wrong, data), "for its card's network and its 4 classes"),
        ((model, start), "is cut before its"),
        ((model, silent), "no labels; scoring needs them; make some with: eskin label"),
        ((model,), "no recording given"),
        ((), "model"),
        ((model, data, "--picture", tmp_path), "is a folder"),
        ((model, data, "--picture", model / "a.png"), "is no folder"),
        ((model, data, "--picture", tmp_path / "new/a.foo"), "'foo' is not supported"),
        ((model, data, "--threshold", "1"), "--threshold"),
    ):
        code, _, err = call(capsys, *argv)
        assert code == 2, (argv, err)
        assert message in err
        assert len(err.splitlines()) == 1
        assert set(tmp_path.rglob("*")) == files
