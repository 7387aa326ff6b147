"""Tests of the listener that recognises touches and reports faults."""

from dataclasses import asdict, replace

import pytest

from eskin.drivers import Event
from eskin.errors import SkinMismatchError
from eskin.live import Detection, Recognizer
from eskin.stream import Recognition, RecognitionState, Stream
from helpers.live import calibration_of, model_of, mounted, network, scans, two_hands
from helpers.streams import INFO, Ear, make_scans, played


def build_recognizer(on):
    return Recognizer(model_of(network()), on, calibration_of(on.skin))


def run_recognition(on, stream, *listeners):
    """Recognise a stream of scans; return the listener that did."""
    source = played(stream)
    source.info = replace(INFO, mounted=on)
    recognition = Recognition(build_recognizer(on), drop="never")
    with Stream(source, [recognition, *listeners]) as running:
        running.wait()
    return recognition


def test_stream_detects_what_its_recogniser_does_scan_by_scan():
    on = mounted()
    stream = scans(on, two_hands(on), 25, 4.4)
    alone = build_recognizer(on)
    expected = [d for scan in stream for d in alone.push(scan)] + alone.finish()
    policy = Ear("policy", message_types=(Detection,))
    view = Ear("view", message_types=(RecognitionState, Detection))
    recognition = run_recognition(on, stream, policy, view)
    found = [asdict(detection.record()) for detection in policy.received]
    assert found == [asdict(detection.record()) for detection in expected]
    assert len(expected) == 3
    states = [item for item in view.received if isinstance(item, RecognitionState)]
    assert [s.state.reading.stamp for s in states] == [scan.stamp for scan in stream]
    for state in states:
        assert set(state.probabilities) == {touch.id for touch in state.state.open}
        for detection in state.detections:
            assert view.received.index(detection) < view.received.index(state)
    published = [detection for state in states for detection in state.detections]
    assert published == policy.received[: len(published)]
    assert recognition.step.count == recognition.age.count == len(stream)
    assert 0 < recognition.step.quantile(0.5) <= recognition.step.quantile(0.99)


def test_source_of_another_skin_is_refused():
    recognition = Recognition(build_recognizer(mounted()))
    with pytest.raises(SkinMismatchError, match="sim:test.*'square'"):
        with Stream(played(make_scans(2)), [recognition]):
            pass


def test_stuck_taxel_is_an_event_of_the_stream():
    on = mounted()
    stream = scans(on, [], 25, 12.0)
    for scan in stream[100:]:
        scan.counts[5] = 1234
    listener = Ear(message_types=(Event,))
    run_recognition(on, stream, listener)
    events = [event for event in listener.received if event.taxel is not None]
    assert {event.taxel for event in events} == {5}
    assert (events[0].kind, events[-1].kind) == ("fault", "fault")
    assert "frozen" in events[-1].text
