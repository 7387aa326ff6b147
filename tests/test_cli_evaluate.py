"""Tests of `eskin evaluate`: scores of clips and of streams, plots and refusals."""

from dataclasses import replace
from functools import partial

import pytest

from eskin.learn.commands.evaluate import (
    CLIP_KEYS,
    describe,
    describe_delay,
    describe_interval,
    summarise_people,
)
from eskin.recording import RecordingWriter, read_recording, write_all
from helpers.cli import assert_refused, call_json
from helpers.learning import SECOND, START, record, record_people
from helpers.live import model_of, network

pytestmark = pytest.mark.slow

VOCABULARY = ("none", "hold", "tap")
PLOTS = ("picture", "reliability", "event-picture", "event-reliability", "curve")


def make_model(vocabulary=VOCABULARY, kind="pressure"):
    net = network(kind, vocabulary=vocabulary, width=4, layers=1, channels=8)
    return model_of(net, vocabulary)


@pytest.fixture(scope="module")
def data(tmp_path_factory):
    folder = tmp_path_factory.mktemp("data")
    record_people(folder, ("ann", "bob"))
    return folder


@pytest.fixture(scope="module")
def ann(data):
    return data / "ann.mcap"


@pytest.fixture(scope="module")
def model(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "m.safetensors"
    make_model().save(path)
    return path


@pytest.fixture
def evaluate(capsys):
    """Return a function that runs the command and returns its result and output."""
    return partial(call_json, capsys, "evaluate", "--workers", "1")


@pytest.fixture
def refuse(capsys):
    """Return a function that checks that the command refuses its input."""
    return partial(assert_refused, capsys, "evaluate", "--workers", "1")


def test_real_recordings_are_scored_by_clips_and_by_events(
    model, data, ann, tmp_path, evaluate
):
    plots = {f"--{name}": tmp_path / "plots" / f"{name}.png" for name in PLOTS}
    options = [word for pair in plots.items() for word in pair]
    result, out = evaluate(model, data, *options)
    assert list(result) == [*CLIP_KEYS, "events"]
    assert set(result["per_class"]) == set(VOCABULARY)
    for scores in result["per_class"].values():
        assert set(scores) == {"precision", "recall", "f1", "count"}
    assert set(result["per_subject"]) == {"ann", "bob", "mean", "sd", "worst"}
    assert set(result["instants"]) == {"accuracy", "macro_f1"}
    low, high = result["accuracy_interval"]
    assert low <= result["accuracy"] <= high
    assert all(0 <= result[key] <= 1 for key in ("accuracy", "macro_f1", "ece"))
    assert f"segments: accuracy {result['accuracy']:.3f}" in out
    assert "hold" in out and "ann" in out
    events = result["events"]
    shares = ("precision", "recall", "f1")
    assert {*shares, "false_per_hour", "latency_ms_p50"} <= set(events)
    assert all(events[key] is None or 0 <= events[key] <= 1 for key in shares)
    assert events["events"] == 4
    counts = {name: row["count"] for name, row in events["per_gesture"].items()}
    assert counts == {"hold": 2, "tap": 2}
    assert events["simultaneous_f1"] is None
    names = events["confusion"]["names"]
    counts = events["confusion"]["counts"]
    assert len(counts) == len(names) and sum(map(sum, counts[:-1])) == 4
    errors = events["errors"]
    assert errors["made"] == 4
    assert errors["found"] + errors["missed"] + errors["wrong_names"] == 4
    assert f"4 gestures made: {errors['found']} found" in out
    assert "near-words taken for a gesture: none was made" in out
    assert events["near_words"] == {}
    for plot in plots.values():
        assert plot.read_bytes().startswith(b"\x89PNG")
    curve = events.pop("curve")
    [shipped] = [point for point in curve if point["is_shipped"]]
    assert shipped["false_per_hour"] == events["false_per_hour"]
    assert shipped["accidents_per_hour"] == errors["accidents_per_hour"]
    assert shipped["missed"] == pytest.approx(errors["missed"] / 4)
    assert shipped["wrong_names"] == pytest.approx(errors["wrong_names"] / 4)
    assert set(events.pop("missed_at_accidents_per_hour")) == {"0.5", "5"}
    assert "missed, by accidents an hour: " in out
    paths = (data / "bob.mcap", ann)
    assert evaluate(model, *paths)[0] == result, "order does not matter"


def test_figures_that_say_nothing_are_left_out_or_explained():
    assert (describe(float("nan")), describe(0.5)) == ("-", "0.500")
    assert describe_delay(-0.56) == "560 ms before" and describe_delay(0.1) == "100 ms"
    assert describe_delay(float("nan")) == "-"
    assert describe_interval(0.25, 0.75) == "(0.250 to 0.750)"
    for low, high in ((1.0, 1.0), (float("nan"), float("nan"))):
        assert "too few examples" in describe_interval(low, high)


def test_scores_of_people_are_summarised():
    """A person with the name of a summary keeps a name of their own."""
    found = summarise_people({"mean": 0.5, "ann": 0.7})
    summary = {"mean": 0.6, "sd": pytest.approx(0.1414), "worst": 0.5}
    assert found == {"person mean": 0.5, "ann": 0.7, **summary}
    alone = {"ann": 0.7, "mean": 0.7, "sd": 0.0, "worst": 0.7}
    assert summarise_people({"ann": 0.7}) == alone


def record_simulated(path, gestures, clips, **options):
    """Write a recording as if generated, as one stream or cut into clips."""
    whole = read_recording(record(path.with_stem("whole"), gestures, **options))
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


def test_simulated_streams_are_scored_by_their_events_alone(
    model, tmp_path, evaluate, refuse
):
    gestures = ("hold", "rub", "tap", "hold", "tap")
    path = record_simulated(tmp_path / "s.mcap", gestures, clips=False, subject="ann")
    result, _ = evaluate(model, path)
    assert all(result[key] is None for key in CLIP_KEYS)
    assert result["events"]["unknown"]["rub"]["count"] == 1
    assert result["events"]["unknown_abstained"] in (0.0, 1.0)
    assert set(result["events"]["per_subject"]) == {"ann", "mean", "sd", "worst"}
    refuse(model, path, "--picture", tmp_path / "p.png", part="no clips")
    refuse(model, path, "--events", "none", part="--events none")


def test_events_of_simulated_clips_are_scored_on_request(
    model, ann, tmp_path, evaluate
):
    clips = record_simulated(tmp_path / "c.mcap", ("hold",) * 6, clips=True)
    words = (model, ann, clips, "--events")
    streams, every, none = (
        evaluate(*words, which)[0]["events"] for which in ("streams", "all", "none")
    )
    assert streams["events"] == 2
    assert every["hours"] > streams["hours"]
    assert none is None


def test_truncated_recording_is_scored_up_to_the_cut_and_named(
    model, ann, tmp_path, evaluate
):
    half = tmp_path / "half.mcap"
    data = ann.read_bytes()
    half.write_bytes(data[: len(data) * 3 // 4])
    result, out = evaluate(model, half)
    assert "half.mcap is cut or damaged" in " ".join(out.split())
    assert 0 < sum(row["count"] for row in result["per_class"].values()) <= 2


def test_invalid_input_is_refused_and_nothing_is_written(
    model, data, ann, tmp_path, refuse
):
    start = tmp_path / "start.mcap"
    damaged = tmp_path / "damaged.safetensors"
    damaged.write_bytes(model.read_bytes()[:200])
    start.write_bytes(ann.read_bytes()[:200])
    shear, other, wrong = (tmp_path / name for name in ("shear", "other", "wrong"))
    make_model(kind="shear").save(shear)
    make_model(("none", "hold", "grab")).save(other)
    card = replace(make_model().card, vocabulary=(*VOCABULARY, "wave"))
    replace(make_model(), card=card).save(wrong)
    silent = record(tmp_path / "silent.mcap", labels=[])
    gone = tmp_path / "gone"
    picture = tmp_path / "new" / "a.png"
    no_events = ("--events", "none", "--event-picture", picture)
    files = set(tmp_path.rglob("*"))
    for words, part in (
        ((model, gone), "no recording at"),
        ((gone, data), "no such model"),
        ((damaged, data), "is no model file"),
        ((ann, data), "is no model file"),
        ((model, model), "recording made by eskin"),
        ((shear, data), "needs shear"),
        ((other, data), "hold tap"),
        ((wrong, data), "4 classes"),
        ((model, start), "is cut before its"),
        ((model, silent), "eskin label"),
        ((model,), "no recording given"),
        ((), "model"),
        ((model, data, "--picture", tmp_path), "is a folder"),
        ((model, data, "--event-picture", tmp_path), "is a folder"),
        ((model, data, "--picture", model / "a.png"), "is no folder"),
        ((model, data, "--picture", picture.with_suffix(".foo")), ".png, .svg, .pdf"),
        ((model, data, *no_events), "no streams"),
        ((model, data, "--threshold", "1"), "--threshold"),
        ((model, data, "--workers", "0"), "--workers is 0"),
    ):
        refuse(*words, part=part)
        assert set(tmp_path.rglob("*")) == files
