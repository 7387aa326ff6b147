"""`eskin evaluate`, as it is called."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from eskin.cli.evaluate import CLIP_KEYS, summarise_people
from eskin.cli.main import run
from eskin.model import save_model
from eskin.recording import RecordingWriter, read_recording, write_all
from helpers.learning import SECOND, START, record, record_people
from helpers.live import model_of, network

VOCABULARY = ("none", "hold", "tap")


def call(capsys, *argv):
    code = run(["evaluate", "--workers", "1", *(str(word) for word in argv)])
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
    assert list(result) == [*CLIP_KEYS, "events"]
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
    low, high = result["accuracy_interval"]
    assert low <= result["accuracy"] <= high
    values = [result[key] for key in ("accuracy", "macro_f1", "ece")]
    assert all(0 <= value <= 1 for value in values)
    assert f"segments: accuracy {result['accuracy']:.3f}" in out
    assert "hold" in out and "ann" in out


def test_a_person_called_like_a_score_keeps_both_apart():
    found = summarise_people({"mean": 0.5, "ann": 0.7})
    three = {"mean": 0.6, "sd": pytest.approx(0.1414), "worst": 0.5}
    assert found == {"person mean": 0.5, "ann": 0.7, **three}
    assert summarise_people({"ann": 0.7}) == {
        "ann": 0.7,
        "mean": 0.7,
        "sd": 0.0,
        "worst": 0.7,
    }


def test_recordings_may_be_given_one_by_one_in_any_order(model, data, capsys):
    a, b = sorted(data.iterdir())
    whole = last_json(call(capsys, model, data, "--json")[1])
    assert last_json(call(capsys, model, b, a, "--json")[1]) == whole


def test_pictures_are_drawn_where_asked(model, data, tmp_path, capsys):
    options = ("picture", "reliability", "event-picture", "event-reliability")
    pictures = {f"--{name}": tmp_path / "made" / f"{name}.png" for name in options}
    words = [word for pair in pictures.items() for word in pair]
    code, _, _ = call(capsys, model, data, *words)
    assert code == 0
    for picture in pictures.values():
        assert picture.read_bytes().startswith(b"\x89PNG")


def test_recordings_are_scored_by_their_events_too(model, data, capsys):
    code, out, _ = call(capsys, model, data, "--json")
    assert code == 0
    events = last_json(out)["events"]
    shares = ("precision", "recall", "f1")
    assert {*shares, "false_per_hour", "latency_ms_p50"} <= set(events)
    assert all(events[key] is None or 0 <= events[key] <= 1 for key in shares)
    assert events["events"] == 4
    assert set(events["per_gesture"]) == {"hold", "tap"}
    assert sum(row["count"] for row in events["per_gesture"].values()) == 4
    assert events["simultaneous_f1"] is None
    names, counts = events["confusion"]["names"], events["confusion"]["counts"]
    assert len(counts) == len(names) and sum(map(sum, counts[:-1])) == 4
    assert "false an hour" in out
    code, out, _ = call(capsys, model, data, "--events", "none", "--json")
    assert (code, last_json(out)["events"]) == (0, None)


def simulated(path, gestures, clips, **options):
    """A recording as if generated, as one stream or cut into clips."""
    whole = read_recording(record(path, gestures, **options))
    metadata = replace(whole.metadata, notes={"simulated": "true"})
    kept = [
        scan
        for scan in whole.scans()
        if not clips or (scan.stamp - START) % (2 * SECOND) < 0.5 * SECOND
    ]
    made = whole.skin, whole.calibration, metadata
    with RecordingWriter(path, whole.robot_name, *made) as writer:
        write_all(writer, kept, [] if clips else whole.labels)
    return path


def test_simulated_streams_are_scored_by_their_events_alone(model, tmp_path, capsys):
    gestures = ("hold", "rub", "tap", "hold", "tap")
    simulated(tmp_path / "s.mcap", gestures, clips=False, subject="ann")
    code, out, err = call(capsys, model, tmp_path / "s.mcap", "--json")
    assert (code, err) == (0, "")
    result = last_json(out)
    assert all(result[key] is None for key in CLIP_KEYS)
    assert result["events"]["unknown"]["rub"]["count"] == 1
    assert result["events"]["unknown_abstained"] in (0.0, 1.0)
    assert set(result["events"]["per_subject"]) == {"ann", "mean", "sd", "worst"}
    argv = (model, tmp_path / "s.mcap", "--picture", tmp_path / "p.png")
    code, _, err = call(capsys, *argv)
    assert code == 2
    assert "no clips among the recordings to draw" in err
    code, _, err = call(capsys, model, tmp_path / "s.mcap", "--events", "none")
    assert code == 2
    assert "all recordings given are streams, which --events none leaves out" in err


def test_simulated_clips_are_scored_by_their_events_only_if_asked(
    model, data, tmp_path, capsys
):
    path = simulated(tmp_path / "c.mcap", ("hold",) * 6, clips=True)
    code, out, _ = call(capsys, model, data / "ann.mcap", path, "--json")
    assert (code, last_json(out)["events"]["events"]) == (0, 2)
    every = (model, data / "ann.mcap", path, "--events", "all", "--json")
    hours = last_json(out)["events"]["hours"]
    assert last_json(call(capsys, *every)[1])["events"]["hours"] > hours


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
        ((tmp_path / "gone", data), "no such model; allowed are"),
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
        (
            (model, data, "--picture", tmp_path / "new/a.foo"),
            "allowed are .png, .svg, .pdf",
        ),
        ((model, data, "--threshold", "1"), "--threshold"),
        ((model, data, "--workers", "0"), "--workers is 0; allowed are 1 and above"),
        ((model, data, "--event-picture", tmp_path), "is a folder"),
        (
            (model, data, "--events", "none", "--event-picture", tmp_path / "e.png"),
            "no streams among the recordings",
        ),
    ):
        code, _, err = call(capsys, *argv)
        assert code == 2, (argv, err)
        assert message in err
        assert len(err.splitlines()) == 1
        assert set(tmp_path.rglob("*")) == files
