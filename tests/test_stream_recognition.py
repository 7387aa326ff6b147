"""Tests of the listener that recognises touches and reports faults."""

from dataclasses import asdict, replace

import pytest

from eskin.drivers import Event
from eskin.errors import SkinMismatchError
from eskin.live import Detection, Recognizer
from eskin.stream import FaultReporter, Recognition, RecognitionState, Stream
from eskin.touch import Fault
from helpers.live import calibration_of, model_of, mounted, network, scans, two_hands
from helpers.streams import INFO, START, Ear, make_scans, played


def build_recognizer(on):
    return Recognizer(model_of(network()), on, calibration_of(on.skin))


def run_recognition(on, stream, *listeners):
    """Recognise a stream of scans; return the listener that did."""
    source = played(stream)
    source.info = replace(
        INFO, skin=on.skin, joint_names=tuple(on.robot.joint_names), robot_name="table"
    )
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


def fault(kind, row=None, column=None, taxel=None, patch="a"):
    return Fault(kind, patch, row, column, taxel, START)


TAXEL, ROW, PATCH = fault("stuck", 1, 2, 17), fault("row", row=1), fault("patch")
COLUMN = fault("column", column=2)


def report(reporter, *faults):
    """Return kinds and places of the events of a reading."""
    return [
        (event.kind, event.patch, event.row, event.column, event.taxel)
        for event in reporter.push(START, faults)
    ]


def test_fault_is_reported_when_it_comes_and_when_it_goes():
    reporter = FaultReporter()
    assert report(reporter) == []
    assert report(reporter, TAXEL) == [("fault", "a", 1, 2, 17)]
    assert report(reporter, replace(TAXEL, since=START + 5)) == []
    assert report(reporter, TAXEL, ROW) == [("fault", "a", 1, None, None)]
    assert report(reporter, ROW) == []
    assert report(reporter) == [("mended", "a", 1, None, None)]


@pytest.mark.parametrize(
    ("other", "covers"),
    [
        (ROW, True),
        (COLUMN, True),
        (PATCH, True),
        (fault("row", row=2), False),
        (fault("patch", patch="b"), False),
    ],
)
def test_part_of_a_larger_fault_is_not_over(other, covers):
    reporter = FaultReporter()
    report(reporter, TAXEL)
    mended = [("mended", "a", 1, 2, 17)] * (not covers)
    place = "fault", other.patch, other.row, other.column, None
    assert report(reporter, other) == [*mended, place]


@pytest.mark.parametrize(
    ("found", "parts"),
    [
        (TAXEL, ("taxel 17", "row 1, column 2", "patch 'a'", "frozen")),
        (ROW, ("row 1 of patch 'a'", "lines")),
        (COLUMN, ("column 2 of patch 'a'", "lines")),
        (PATCH, ("patch 'a'", "silent")),
    ],
)
def test_text_of_a_fault_names_its_place(found, parts):
    reporter = FaultReporter()
    [event], [over] = reporter.push(START, [found]), reporter.push(START, [])
    assert all(part in event.text for part in parts)
    assert over.text.startswith(event.text.split(" is ")[0])


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
