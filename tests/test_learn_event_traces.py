"""Tests of traces, on which decisions are made as live, and of tuning on them."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from joblib import parallel_config

from eskin.errors import RecordingError
from eskin.learn.events import (
    Tally,
    TuningConfig,
    choose_decision,
    is_stream,
    read_true_events,
    score_events,
    trace_recording,
    trace_recordings,
    traces,
)
from eskin.live import DecisionConfig, Recognizer
from eskin.recording import read_recording
from eskin.sim.dataset import GenerationSettings, generate
from helpers.live import (
    VOCABULARY,
    Press,
    label,
    model_of,
    mounted,
    network,
    record,
    say_always,
    scans,
    two_hands,
    with_closing_layer,
)
from helpers.simulation import StandIn

pytestmark = pytest.mark.slow

DECISIONS = [
    (DecisionConfig(), 1.0),
    (DecisionConfig(threshold=0.4, dwell_seconds=0.0, least=0.6), 4.0),
    (DecisionConfig(thresholds={"poke": 0.3, "stroke": 2.0}, dwell_seconds=0.12), 1.0),
    (
        DecisionConfig(threshold=0.35, dwell_seconds=0.3, least=0.0, min_travel=0.001),
        2.0,
    ),
    (DecisionConfig(threshold=2.0, least=1.0, min_travel=1.0), 1.0),
    (DecisionConfig(threshold=2.0, lifted=0.3, lift_seconds=0.1), 0.5),
]
"""Settings of the decision, each with a temperature."""


def recognize(recording, model, config):
    """Return the detections that are made live."""
    on = mounted(calibrated=recording.skin.calibrated)
    recognizer = Recognizer(model, on, recording.calibration, config)
    found = [d for scan in recording.scans() for d in recognizer.push(scan)]
    return [*found, *recognizer.finish()]


def merging_touches(on):
    """Return two touches that become one, and one that is open at the end."""
    return [Press(2.4, 3.6, 60, 73), Press(2.4, 3.6, 89, 76), Press(4.4, 5.6, 65, 72)]


@pytest.mark.parametrize(
    ("calibrated", "scene", "closing"),
    [
        (True, two_hands, False),
        (True, merging_touches, False),
        (False, two_hands, False),
        (True, two_hands, True),
        (False, two_hands, True),
    ],
)
def test_trace_gives_the_detections_made_live(tmp_path, calibrated, scene, closing):
    on = mounted(calibrated=calibrated)
    stream = scans(on, scene(on), 15, 5.2)
    recording = read_recording(record(tmp_path / "a.mcap", on, stream))
    model = model_of(network(seed=3))
    if closing:
        model = with_closing_layer(model, 0.5)
    trace = trace_recording(recording, model)
    assert 0 < len(trace.steps) < len(stream)
    answers = set()
    for config, temperature in DECISIONS:
        warm = replace(model, card=replace(model.card, temperature=temperature))
        expected = recognize(recording, warm, config)
        found = trace.decide(config, temperature)
        assert [d.record() for d in found] == [d.record() for d in expected]
        assert [d.touch for d in found] == [d.touch for d in expected]
        answers.add(tuple((d.stamp, d.gesture) for d in found))
    assert len(answers) > 2
    assert trace.temperature == 1.0


def test_trace_decides_by_the_settings_of_the_model_unless_others_are_given(tmp_path):
    on = mounted()
    model = say_always("poke")
    stream = scans(on, [Press(2.4, 2.9, 100, 100)], 25, 4)
    recording = read_recording(record(tmp_path / "a.mcap", on, stream))
    late = replace(model.card, decision=DecisionConfig(threshold=2.0))
    [early] = trace_recording(recording, model).decide()
    trace = trace_recording(recording, replace(model, card=late))
    [at_closing] = trace.decide()
    assert at_closing.stamp > early.stamp
    assert [d.stamp for d in trace.decide(DecisionConfig())] == [early.stamp]


def copy(value):
    """Return a value as another process receives it."""
    return pickle.loads(pickle.dumps(value))


class SpreadPresses(StandIn):
    """This stand-in makes streams of 11 s, whose presses are on different taxels."""

    def make(self, plan):
        clip = super().make(replace(plan, seconds=min(plan.seconds, 11.0)))
        positions = self.mounted.skin.positions
        truths = []
        for truth in clip.truths:
            place = positions[truth.number % len(positions)]
            centroid = np.tile(place, (len(clip.counts), 1))
            gesture = "poke" if truth.number % 3 else "rub"
            truths.append(replace(truth, centroid=centroid, gesture=gesture))
        return replace(clip, truths=tuple(truths))


@pytest.fixture(scope="module")
def stream_paths(tmp_path_factory):
    """Generate a set of two streams, and return the paths of its recordings."""
    folder = tmp_path_factory.mktemp("streams")
    generate(folder, GenerationSettings("streams", clips=2), 0, SpreadPresses)
    return sorted(folder.glob("*.mcap"))


def test_generated_streams_are_scored_from_end_to_end(stream_paths):
    streams = list(trace_recordings(stream_paths, say_always("poke")))
    result = score_events([stream.decide() for stream in streams], VOCABULARY)
    truths = [len(read_true_events(read_recording(path))) for path in stream_paths]
    rubs = result.unknown["rub"].count
    assert (truths, rubs) == ([2, 2], 2)
    # The model knows no other gesture, so every unknown one is a false detection.
    assert result.total == Tally(sum(truths) - rubs, 0, rubs)
    assert result.unknown["rub"].mistaken == rubs
    assert 0 < result.all_delays.from_onset(50) < 0.2
    seconds = sum(stream.seconds for stream in streams)
    assert result.hours == pytest.approx(seconds / 3600)
    assert set(result.per_subject) == {"streams-p0", "streams-p1"}


def test_two_workers_trace_like_one_and_what_passes_between_processes_can(
    tmp_path, monkeypatch
):
    on = mounted()
    model = say_always("poke")
    paths = []
    for index in range(2):
        stream = scans(on, [Press(2.3, 2.9, 100 + index, 100)], 25, 4.0)
        labels = [label(2.3, 2.9, "poke")]
        paths.append(record(tmp_path / f"{index}.mcap", on, stream, labels))
    alone = list(trace_recordings(paths, model))
    # Threads start at once; what processes receive is copied as they do it.
    monkeypatch.setattr(
        traces, "parallel_config", lambda *_, **__: parallel_config("threading")
    )
    together = copy(list(trace_recordings(paths, copy(model), workers=2)))
    assert [traced.path for traced in together] == paths
    for one, other in zip(alone, together, strict=True):
        found = other.decide().detections
        expected = one.decide().detections
        assert [d.record() for d in found] == [d.record() for d in expected]


def test_recording_is_a_stream_unless_it_is_a_generated_set_of_clips(
    stream_paths, tmp_path
):
    settings = GenerationSettings("val", clips=6, subjects=1)
    generate(tmp_path / "val", settings, 0, StandIn)
    [clips] = (tmp_path / "val").glob("*.mcap")
    on = mounted()
    real = record(tmp_path / "real.mcap", on, scans(on, [], 25, 1))
    found = [is_stream(read_recording(path)) for path in (*stream_paths, real, clips)]
    assert found == [True, True, True, False]


def test_real_recording_is_scored_against_its_labels(tmp_path):
    on = mounted()
    model = say_always("poke")
    stream = scans(on, [Press(2.3, 2.9, 100, 100)], 25, 4.0)
    path = record(tmp_path / "a.mcap", on, stream, [label(2.3, 2.9, "poke")])
    [traced] = trace_recordings([path], model)
    assert score_events([traced.decide()], VOCABULARY).total.f1 == 1.0
    assert traced.subject == "one"
    silent = record(tmp_path / "silent.mcap", on, stream[:5])
    trace = trace_recording(read_recording(silent), model)
    assert (trace.steps, trace.decide()) == ((), [])
    with pytest.raises(RecordingError, match="silent.mcap has no labels"):
        list(trace_recordings([silent], model))


def test_no_single_change_improves_the_decision_chosen(stream_paths):
    streams = list(trace_recordings(stream_paths[:1], model_of(network(seed=3))))
    config = TuningConfig(
        thresholds=(0.3, 0.9),
        lifteds=(0.4, 1.1),
        lifts=(0.1, 0.3),
        leasts=(0.0, 0.9),
        dwells=(0.06, 0.2),
    )
    chosen, result = choose_decision(streams, config)
    values = {
        "threshold": config.thresholds,
        "lifted": config.lifteds,
        "lift_seconds": config.lifts,
        "least": config.leasts,
        "dwell_seconds": config.dwells,
    }

    def cost(score):
        total = score.total
        accidents = score.accidents.mistaken
        return total.missed + config.false * total.false + config.accident * accidents

    others = [replace(chosen, **{name: v}) for name, vs in values.items() for v in vs]
    for other in (chosen, DecisionConfig(), *others):
        tried = score_events([stream.decide(other) for stream in streams], VOCABULARY)
        if other == chosen:
            assert tried.total == result.total
        if tried.all_delays.latency(50) <= config.latency:
            assert cost(tried) >= cost(result)
    alone, _ = choose_decision(streams, replace(config, each=False))
    assert not alone.thresholds
