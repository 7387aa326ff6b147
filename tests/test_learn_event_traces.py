"""What is decided on a trace is what the recogniser says live."""

from dataclasses import replace

import numpy as np
import pytest

from eskin.errors import RecordingError
from eskin.learn.events import (
    TuningConfig,
    choose_decision,
    is_stream,
    read_true_events,
    score_events,
    trace_recording,
    trace_recordings,
)
from eskin.live import Recognizer
from eskin.model import DecisionConfig
from eskin.recording import read_recording
from eskin.sim.dataset import GenerationSettings, generate
from helpers.live import (
    SECOND,
    START,
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
)
from helpers.simulation import StandIn

DECISIONS = [
    DecisionConfig(),
    DecisionConfig(threshold=0.4, hold_seconds=0.0, least=0.6),
    DecisionConfig(thresholds={"poke": 0.3, "stroke": 2.0}, hold_seconds=0.12),
    DecisionConfig(threshold=0.35, hold_seconds=0.3, least=0.0, still=0.001),
    DecisionConfig(threshold=2.0, least=1.0, still=1.0),
    DecisionConfig(threshold=2.0, lifted=0.3, lift_seconds=0.1),
]


def live(recording, model, config):
    on = mounted(calibrated=recording.skin.calibrated)
    recognizer = Recognizer(model, on, recording.calibration, config)
    found = []
    for scan in recording.scans():
        found += recognizer.push(scan)
    return [*found, *recognizer.finish()]


def one_toward_the_other(on):
    """Two touches that become one, and then one that the recording cuts off."""
    return [
        Press(2.4, 3.6, 60, 73),
        Press(2.4, 3.6, 89, 76),
        Press(4.4, 5.6, 65, 72),
    ]


@pytest.mark.parametrize("calibrated", [True, False])
@pytest.mark.parametrize("scene", [two_hands, one_toward_the_other])
def test_a_trace_says_what_the_recogniser_says_live(tmp_path, scene, calibrated):
    on = mounted(calibrated=calibrated)
    stream = scans(on, scene(on), 15, 5.2)
    recording = read_recording(record(tmp_path / "a.mcap", on, stream))
    model = model_of(network(seed=3))
    trace = trace_recording(recording, model)
    assert 0 < len(trace.steps) < len(stream)
    said = set()
    for config, heat in zip(DECISIONS, (1.0, 4.0, 1.0, 2.0, 1.0, 0.5), strict=True):
        warm = replace(model, card=replace(model.card, temperature=heat))
        expected = live(recording, warm, config)
        found = trace.decide(config, heat)
        assert [d.record() for d in found] == [d.record() for d in expected]
        assert [d.touch for d in found] == [d.touch for d in expected]
        said.add(tuple((d.stamp, d.gesture) for d in found))
    assert len(said) > 2
    assert trace.temperature == 1.0


def test_a_trace_decides_as_the_model_does_unless_told_otherwise(tmp_path):
    on = mounted()
    press = Press(2.4, 2.9, 100, 100)
    path = record(tmp_path / "a.mcap", on, scans(on, [press], 25, 4))
    model = say_always("poke")
    late = DecisionConfig(threshold=2.0)
    shy = replace(model, card=replace(model.card, decision=late))
    [early] = trace_recording(read_recording(path), model).decide()
    trace = trace_recording(read_recording(path), shy)
    [at_closing] = trace.decide()
    assert at_closing.stamp > early.stamp
    assert [d.stamp for d in trace.decide(DecisionConfig())] == [early.stamp]


def test_a_skin_that_nothing_touches_has_nothing_to_decide(tmp_path):
    on = mounted()
    recording = read_recording(record(tmp_path / "a.mcap", on, scans(on, [], 25, 3)))
    trace = trace_recording(recording, say_always("poke"))
    assert trace.steps == ()
    assert trace.decide() == []


class Placed(StandIn):
    """Streams of 11 s whose presses are where their taxels are, each on another one."""

    def make(self, plan):
        clip = super().make(replace(plan, seconds=min(plan.seconds, 11.0)))
        positions = self.mounted.skin.positions
        counts = clip.counts.copy()
        truths = tuple(
            replace(
                truth,
                centroid=np.tile(
                    positions[truth.number % len(positions)], (len(counts), 1)
                ),
                gesture="poke" if truth.number % 3 else "rub",
            )
            for truth in clip.truths
        )
        return replace(clip, truths=truths)


@pytest.fixture(scope="module")
def sets(tmp_path_factory):
    """A generated stream, and a generated set of clips."""
    folder = tmp_path_factory.mktemp("sets")
    generate(folder / "streams", GenerationSettings("streams", clips=2), 0, Placed)
    generate(
        folder / "val", GenerationSettings("val", clips=12, subjects=2), 0, StandIn
    )
    return folder


def test_a_generated_stream_is_scored_from_end_to_end(sets):
    model = say_always("poke")
    paths = sorted((sets / "streams").glob("*.mcap"))
    streams = list(trace_recordings(paths, model))
    result = score_events([stream.decide() for stream in streams], VOCABULARY)
    truths = [len(read_true_events(read_recording(path))) for path in paths]
    rubs = result.unknown["rub"].count
    assert (truths, rubs) == ([2, 2], 2)
    assert result.total.missed == 0
    assert result.total.matched == sum(truths) - rubs
    # The model knows no other word, so every unknown gesture is false.
    assert result.total.false == result.unknown["rub"].mistaken == rubs
    assert 0 < result.all_delays.from_onset(50) < 0.2
    seconds = sum(stream.seconds for stream in streams)
    assert result.hours == pytest.approx(seconds / 3600)
    assert set(result.per_subject) == {"streams-p0", "streams-p1"}


def test_recordings_heard_by_other_processes_are_heard_alike(sets):
    model = say_always("poke")
    paths = sorted((sets / "streams").glob("*.mcap"))
    alone, together = (
        list(trace_recordings(paths, model)),
        list(trace_recordings(paths, model, 2)),
    )
    for one, other in zip(alone, together, strict=True):
        assert one.path == other.path
        assert [d.record() for d in one.decide().detections] == [
            d.record() for d in other.decide().detections
        ]


def test_only_sets_of_clips_are_no_streams(sets, tmp_path):
    def of(folder):
        return [
            is_stream(read_recording(p)) for p in sorted((sets / folder).glob("*.mcap"))
        ]

    assert of("streams") == [True, True]
    assert of("val") == [False, False]
    on = mounted()
    recorded = record(tmp_path / "real.mcap", on, scans(on, [], 25, 1))
    assert is_stream(read_recording(recorded))


def test_what_happened_must_be_known(tmp_path):
    on = mounted()
    stream = scans(on, two_hands(on), 25, 5.5)
    silent = record(tmp_path / "silent.mcap", on, stream)
    with pytest.raises(RecordingError, match="silent.mcap has no labels; scoring"):
        list(trace_recordings([silent], say_always("poke")))


def test_labels_tell_what_happened_where_no_truth_does(tmp_path):
    on = mounted()
    stream = scans(on, [Press(2.3, 2.9, 100, 100)], 25, 4.0)
    path = record(tmp_path / "a.mcap", on, stream, [label(2.3, 2.9, "poke")])
    [heard] = trace_recordings([path], say_always("poke"))
    [event] = heard.events
    assert (event.onset, event.end) == (
        START + round(2.3 * SECOND),
        START + round(2.9 * SECOND),
    )
    assert score_events([heard.decide()], VOCABULARY).total.f1 == 1.0
    assert heard.subject == "one"


def test_no_other_value_of_one_setting_is_better_than_the_decision_chosen(sets):
    model = model_of(network(seed=3))
    streams = list(
        trace_recordings(sorted((sets / "streams").glob("*.mcap"))[:1], model)
    )
    config = TuningConfig(
        thresholds=(0.3, 0.9),
        lifteds=(0.4, 1.1),
        lifts=(0.1, 0.3),
        leasts=(0.0, 0.9),
        holds=(0.06, 0.2),
        unknown=0.0,
    )
    chosen, result = choose_decision(streams, config)
    again = score_events([stream.decide(chosen) for stream in streams], VOCABULARY)
    assert again.total == result.total
    others = [
        DecisionConfig(),
        *(replace(chosen, threshold=value) for value in config.thresholds),
        *(replace(chosen, lifted=value) for value in config.lifteds),
        *(replace(chosen, lift_seconds=value) for value in config.lifts),
        *(replace(chosen, least=value) for value in config.leasts),
        *(replace(chosen, hold_seconds=value) for value in config.holds),
    ]
    for other in others:
        tried = score_events([stream.decide(other) for stream in streams], VOCABULARY)
        if tried.all_delays.latency(50) <= config.latency:
            assert tried.total.f1 <= result.total.f1
    alone, _ = choose_decision(streams, replace(config, each=False))
    assert not alone.thresholds
