"""A stream gives everything to everyone, delays nobody, and ends with all closed."""

import signal
import subprocess
import sys
import textwrap
import threading
import time
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pytest

from eskin.drivers import Event, Source
from eskin.errors import SkinMismatchError, StreamError
from eskin.live import Detection, Recognizer
from eskin.recording import read_recording
from eskin.stream import (
    BoundedQueue,
    DurationHistogram,
    FaultReporter,
    Recognition,
    RecognitionState,
    Stream,
    stop_on_signals,
)
from eskin.touch import Fault, Scan
from helpers.live import calibration_of, model_of, mounted, network, scans, two_hands
from helpers.streams import INFO, START, Ear, make_scans, played, same_scans

SCANS = make_scans(200)
EVENT = Event(START, "appeared", "patch 'a' is there")


@pytest.fixture(autouse=True)
def no_thread_stays():
    before = set(threading.enumerate())
    yield
    assert set(threading.enumerate()) == before


class Watched(Source):
    """A played source that tells whether it was closed; can raise, hang or speak."""

    def __init__(self, scans, do=None, events=()):
        self.inner = played(scans)
        self.info, self.clock = self.inner.info, self.inner.clock
        self.do = do or (lambda: None)
        self.events = list(events)
        self.closed = 0

    def read(self, timeout=None):
        self.do()
        return self.inner.read(timeout)

    @property
    def ended(self):
        return self.inner.ended

    def take_events(self):
        events, self.events = self.events, []
        return events

    def counters(self):
        return self.inner.counters()

    def close(self):
        self.closed += 1
        self.inner.close()


def adds_up(count):
    return count.given == count.taken + count.dropped + count.waiting


def raise_at(number, error):
    calls = []

    def do(*_):
        calls.append(1)
        if len(calls) == number:
            raise error

    return do


# What is heard.


def test_every_listener_hears_every_scan_in_order():
    ears = [Ear("a"), Ear("b", size=1), Ear("c", size=3)]
    with Stream(played(SCANS), ears) as stream:
        assert stream.wait()
        assert all(same_scans(ear.heard, SCANS) for ear in ears)
        assert all(ear.closed == 1 for ear in ears)
        for count in stream.queue_counts().values():
            assert adds_up(count)
            assert (count.taken, count.dropped, count.waiting) == (200, 0, 0)
        assert stream.queue_counts()["b"].longest == 1


def test_each_listener_has_a_thread_of_its_own():
    ears = [Ear("a"), Ear("b")]
    with Stream(played(SCANS), ears) as stream:
        stream.wait()
    threads = {ear.thread for ear in ears}
    assert len(threads) == 2
    assert threading.current_thread() not in threads
    assert all(thread.daemon for thread in threads)


def test_events_of_the_source_come_before_the_scan_they_came_with():
    ear = Ear(message_types=(Scan, Event))
    with Stream(Watched(SCANS, events=[EVENT]), [ear]) as stream:
        stream.wait()
    assert ear.heard[0] == EVENT
    assert same_scans(ear.heard[1:], SCANS)


def test_a_listener_is_told_only_what_it_hears():
    ear = Ear(message_types=(Event,))
    with Stream(Watched(SCANS, events=[EVENT]), [ear]) as stream:
        stream.wait()
        assert stream.queue_counts()["ear"].given == 1
    assert ear.heard == [EVENT]


def test_what_a_listener_tells_all_hear_but_itself():
    teller, other = (
        Ear("teller", message_types=(Scan, Event)),
        Ear("other", message_types=(Event,)),
    )
    teller.do = lambda scan: teller.context.publish(EVENT)
    with Stream(played(SCANS), [teller, other]) as stream:
        stream.wait()
    assert other.heard == [EVENT] * 200
    assert same_scans(teller.heard, SCANS)


def test_what_is_told_at_closing_is_heard_by_those_that_come_later():
    teller, other = Ear("teller"), Ear("other", message_types=(Event,))
    teller.close = lambda: teller.context.publish(EVENT)
    with Stream(played(SCANS), [teller, other]) as stream:
        stream.wait()
    assert other.heard == [EVENT]


def test_a_listener_knows_how_old_a_scan_is():
    ages = []
    ear = Ear(do=lambda scan: ages.append(ear.context.age(scan.stamp)))
    with Stream(played(SCANS, 1000.0), [ear]) as stream:
        stream.wait()
    assert ages == pytest.approx([0.0] * 200, abs=5.0)
    assert min(ages) >= -1e-4


# Queues.


def test_a_stalled_listener_delays_nobody():
    go, stalled, done = (threading.Event() for _ in range(3))
    slow = Ear("viewer", size=5, drop="oldest")
    slow.do = lambda scan: (stalled.set(), go.wait(20))
    fast = Ear("recognition")
    fast.do = lambda scan: done.set() if scan is SCANS[-1] else None

    class Patient(Watched):
        def read(self, timeout=None):
            assert not self.inner.given or stalled.wait(20)
            return super().read(timeout)

    with Stream(Patient(SCANS), [slow, fast]) as stream:
        assert done.wait(20)
        count = stream.queue_counts()["viewer"]
        assert (count.taken, count.waiting, adds_up(count)) == (1, 5, True)
        go.set()
        stream.wait()
        count = stream.queue_counts()["viewer"]
    assert same_scans(fast.heard, SCANS)
    assert (count.given, count.taken, count.dropped) == (200, 6, 194)
    assert count.longest == 5
    assert same_scans(slow.heard[1:], SCANS[-5:])


def test_oldest_keeps_the_newest():
    inbox = filled("oldest", SCANS[:10])
    assert same_scans(rest_of(inbox), SCANS[7:10])


def test_newest_keeps_the_oldest():
    inbox = filled("newest", SCANS[:10])
    assert same_scans(rest_of(inbox), SCANS[:3])


@pytest.mark.parametrize("drop", ["oldest", "newest"])
def test_an_event_is_dropped_after_all_scans(drop):
    a, b, c, d = (Event(START + n, "lost", str(n)) for n in range(4))
    assert rest_of(filled(drop, [*SCANS[:3], a]))[-1] == a
    assert rest_of(filled(drop, [a, *SCANS[:5], b, *SCANS[5:9], c])) == [a, b, c]
    assert rest_of(filled(drop, [a, b, c, SCANS[0]])) == [a, b, c]
    kept = [b, c, d] if drop == "oldest" else [a, b, c]
    assert rest_of(filled(drop, [a, b, c, d])) == kept


def test_never_waits_until_there_is_room():
    inbox = BoundedQueue(2, "never")
    writer = threading.Thread(target=lambda: [inbox.put(s) for s in SCANS])
    writer.start()
    heard = [inbox.take() for _ in SCANS]
    writer.join()
    assert same_scans(heard, SCANS)
    assert inbox.count().longest <= 2


def test_who_waits_for_room_is_let_go_when_the_queue_is_closed():
    inbox = BoundedQueue(1, "never")
    inbox.put(SCANS[0])
    writer = threading.Thread(target=inbox.put, args=(SCANS[1],))
    writer.start()
    inbox.close()
    writer.join(20)
    assert not writer.is_alive()
    assert inbox.take() is None
    assert (inbox.count().dropped, adds_up(inbox.count())) == (2, True)


@pytest.mark.parametrize("drop", ["oldest", "newest"])
def test_counters_add_up_whatever_comes_from_however_many(drop):
    inbox, wrong = BoundedQueue(7, drop), []
    items = [*SCANS, EVENT] * 5

    def bring():
        for item in items:
            inbox.put(item)

    def fetch():
        while inbox.take() is not None:
            if not adds_up(inbox.count()):
                wrong.append(inbox.count())

    bringers = [threading.Thread(target=bring) for _ in range(3)]
    fetcher = threading.Thread(target=fetch)
    for thread in (*bringers, fetcher):
        thread.start()
    for thread in bringers:
        thread.join()
    inbox.end()
    fetcher.join()
    inbox.put(EVENT)
    count = inbox.count()
    assert not wrong
    assert adds_up(count)
    assert (count.given, count.waiting) == (3 * len(items) + 1, 0)
    assert count.longest <= 7


def filled(drop, items, size=3):
    inbox = BoundedQueue(size, drop)
    for item in items:
        inbox.put(item)
    assert adds_up(inbox.count())
    assert inbox.count().given == len(items)
    return inbox


def rest_of(inbox):
    inbox.end()
    return list(iter(inbox.take, None))


def test_a_queue_that_holds_nothing_is_refused():
    with pytest.raises(ValueError, match="allowed is 1 or more"):
        BoundedQueue(0, "oldest")


# Ends.


def test_leaving_stops_the_stream_and_what_is_held_is_still_heard():
    source = Watched(make_scans(2000))
    ear = Ear(size=50, do=lambda scan: time.sleep(0.001))
    with Stream(source, [ear]) as stream:
        assert not stream.wait(0.1)
    count = stream.queue_counts()["ear"]
    assert 0 < count.taken < 2000
    assert (count.dropped, count.waiting, count.given) == (0, 0, count.taken)
    assert (ear.closed, source.closed) == (1, 1)


def test_listeners_are_closed_in_order_then_the_source():
    log, source = [], Watched(SCANS)
    ears = [Ear("a"), Ear("b"), Ear("c")]
    for ear in ears:
        ear.log = log
    close, source.close = source.close, lambda: (log.append("source"), close())
    with Stream(source, ears) as stream:
        stream.wait()
    assert log == ["a", "b", "c", "source"]


@pytest.mark.parametrize("leave", [False, True])
def test_what_a_listener_raises_stops_all_and_is_raised(leave):
    log, source = [], Watched(make_scans(5000))
    ears = [Ear("a"), Ear("b", do=raise_at(3, KeyError("no such touch"))), Ear("c")]
    for ear in ears:
        ear.log = log
    with pytest.raises(StreamError, match="listener 'b' failed") as caught:
        with Stream(source, ears) as stream:
            while leave and stream.failure is None:
                time.sleep(0.001)
            if not leave:
                stream.wait()
    assert isinstance(caught.value.__cause__, KeyError)
    assert "no such touch" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert log == ["a", "b", "c"]
    assert source.closed == 1
    assert all(adds_up(count) for count in stream.queue_counts().values())
    assert len(ears[1].heard) == 2


def test_after_a_failure_nothing_more_is_heard():
    go = threading.Event()
    slow = Ear("slow", do=lambda scan: go.wait(20))
    bad = Ear("bad", do=raise_at(50, KeyError("touch")))
    with pytest.raises(StreamError):
        with Stream(Watched(SCANS), [slow, bad]) as stream:
            for _ in range(300):
                if stream.failure and not stream.queue_counts()["slow"].waiting:
                    break
                time.sleep(0.01)
            go.set()
    assert len(slow.heard) <= 1
    assert stream.queue_counts()["slow"].dropped >= 49


def test_what_the_source_raises_stops_all_and_is_raised():
    source = Watched(SCANS, raise_at(50, OSError("cable is out")))
    ear = Ear()
    with pytest.raises(StreamError, match="source sim:test failed .*cable is out"):
        with Stream(source, [ear]) as stream:
            stream.wait()
    assert (ear.closed, source.closed) == (1, 1)
    assert len(ear.heard) <= 49


def test_what_is_raised_at_closing_is_raised_and_the_others_are_closed():
    bad, good, source = Ear("bad"), Ear("good"), Watched(SCANS)
    bad.close = raise_at(1, OSError("stuck"))
    with pytest.raises(StreamError, match="listener 'bad' failed .*stuck"):
        with Stream(source, [bad, good]) as stream:
            stream.wait()
    assert (good.closed, source.closed) == (1, 1)


def test_a_listener_that_cannot_start_lets_nothing_run():
    source, good, bad = Watched(SCANS), Ear("good"), Ear("bad")
    bad.start = raise_at(1, ValueError("no port"))
    with pytest.raises(ValueError, match="no port"):
        with Stream(source, [good, bad]):
            pass
    assert (good.closed, bad.closed, source.closed) == (1, 0, 1)
    assert good.heard == []


def test_an_error_inside_with_goes_before_that_of_the_stream():
    bad = Ear(do=raise_at(1, KeyError("first")))
    with pytest.raises(ZeroDivisionError):
        with Stream(played(SCANS), [bad]):
            raise ZeroDivisionError


def test_a_listener_that_hangs_is_left_behind_and_the_others_are_closed():
    go = threading.Event()
    bad, good = Ear("bad", do=lambda scan: go.wait(20)), Ear("good", size=3)
    source = Watched(SCANS)
    with pytest.raises(StreamError, match="listener 'bad' failed .*not finished after"):
        with Stream(source, [bad, good], patience=0.2) as stream:
            stream.wait(0.2)
    assert (bad.closed, good.closed, source.closed) == (0, 1, 1)
    go.set()
    bad.thread.join()


@pytest.mark.parametrize("who", ["source", "listener"])
def test_what_holds_up_the_reader_is_named_and_the_rest_is_closed(who):
    go = threading.Event()
    hang = [lambda *_: None, lambda *_: go.wait(20)]
    source = Watched(SCANS, hang[who == "source"])
    bad = Ear("bad", size=1, do=hang[who == "listener"])
    good = Ear("good")
    title = {"source": "source sim:test", "listener": "listener 'bad'"}[who]
    stream = Stream(source, [bad, good], patience=0.2)
    with pytest.raises(StreamError, match=f"{title} failed .*not finished after"):
        with stream:
            stream.wait(0.2)
    assert good.closed == 1
    go.set()
    stream.reader.join()
    stream.workers[0].thread.join()
    assert source.closed == 1


def test_two_listeners_of_one_name_are_refused():
    with pytest.raises(ValueError, match="ear, ear; allowed is each name once"):
        Stream(played(SCANS), [Ear(), Ear()])


# Signals.

STREAMING = """
    import sys, time
    sys.path.insert(0, sys.argv[3])
    from eskin.drivers import HostClock
    from eskin.stream import Recorder, Stream, stop_on_signals, RecorderConfig
    from helpers.streams import METADATA, Ear, make_scans, played
    hang = (lambda scan: time.sleep(60)) if sys.argv[2] == "hang" else None
    source = played(make_scans(5000), 1.0, HostClock())
    recorder = Recorder(sys.argv[1], METADATA, RecorderConfig(least_free=0))
    ear = Ear(do=hang)
    with Stream(source, [recorder, ear]) as stream, stop_on_signals(stream.stop):
        while not ear.thread: time.sleep(0.01)
        print("streaming", flush=True)
        stream.wait()
    print("readings", stream.queue_counts()["recorder"].taken, flush=True)
"""


def start_streaming(path, how="well"):
    code, tests = textwrap.dedent(STREAMING), Path(__file__).parent
    child = subprocess.Popen(
        [sys.executable, "-c", code, path, how, tests],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout.readline() == "streaming\n"
    return child


def test_sigint_and_sigterm_end_with_a_finished_recording(tmp_path):
    children = {
        number: start_streaming(tmp_path / f"{number}.mcap")
        for number in (signal.SIGINT, signal.SIGTERM)
    }
    for number, child in children.items():
        child.send_signal(number)
    for number, child in children.items():
        out, _ = child.communicate(timeout=30)
        recording = read_recording(tmp_path / f"{number}.mcap")
        assert child.returncode == 0
        assert not recording.truncated
        assert out == f"readings {recording.count}\n"
        assert recording.count > 0
    assert len(list(tmp_path.iterdir())) == 2


def test_the_second_ctrl_c_quits_hard(tmp_path):
    child = start_streaming(tmp_path / "a.mcap", "hang")
    while child.poll() is None:
        child.send_signal(signal.SIGINT)
        time.sleep(0.1)
    child.communicate(timeout=30)
    assert child.returncode == -signal.SIGINT


def test_handlers_are_put_back():
    before = [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)]
    stopped = []
    with stop_on_signals(lambda: stopped.append(1)):
        signal.raise_signal(signal.SIGTERM)
        assert stopped == [1]
    assert [signal.getsignal(s) for s in (signal.SIGINT, signal.SIGTERM)] == before


def test_outside_the_main_thread_handlers_stay():
    before, seen = signal.getsignal(signal.SIGINT), []

    def other():
        with stop_on_signals(lambda: None):
            seen.append(signal.getsignal(signal.SIGINT))

    thread = threading.Thread(target=other)
    thread.start()
    thread.join()
    assert seen == [before]


# Recognition.


def recognizer(on):
    return Recognizer(model_of(network()), on, calibration_of(on.skin))


def source_of(on, stream):
    source = played(stream)
    source.info = replace(
        INFO, skin=on.skin, joint_names=tuple(on.robot.joint_names), robot_name="table"
    )
    return source


def test_a_stream_recognises_what_its_recogniser_does_scan_by_scan():
    on = mounted()
    stream = scans(on, two_hands(on), 25, 4.4)
    alone = recognizer(on)
    expected = [d for scan in stream for d in alone.push(scan)]
    expected += alone.finish()
    listener = Recognition(recognizer(on), drop="never")
    words = Ear("policy", message_types=(Detection,))
    view = Ear("view", message_types=(RecognitionState, Detection))
    with Stream(source_of(on, stream), [listener, words, view]) as running:
        running.wait()
    assert len(expected) == 3
    assert [asdict(d.record()) for d in words.heard] == [
        asdict(d.record()) for d in expected
    ]
    moments = [item for item in view.heard if isinstance(item, RecognitionState)]
    assert [m.state.reading.stamp for m in moments] == [scan.stamp for scan in stream]
    for moment in moments:
        assert set(moment.probabilities) == {touch.id for touch in moment.state.open}
        for detection in moment.detections:
            place = view.heard.index(detection)
            assert place < view.heard.index(moment)
    said = [d for moment in moments for d in moment.detections]
    assert said == words.heard[: len(said)]
    assert listener.step.count == listener.age.count == len(stream)
    assert 0 < listener.step.quantile(0.5) <= listener.step.quantile(0.99)


def test_a_source_of_another_skin_is_refused():
    with pytest.raises(SkinMismatchError, match="source sim:test is of skin 'square'"):
        with Stream(played(SCANS), [Recognition(recognizer(mounted()))]):
            pass


# Faults.


def fault(kind, row=None, column=None, taxel=None, since=START, patch="a"):
    return Fault(kind, patch, row, column, taxel, since)


ONE, ROW, PATCH = fault("stuck", 1, 2, 17), fault("row", row=1), fault("patch")


def told(watch, *faults):
    return [
        (event.kind, event.patch, event.row, event.column, event.taxel)
        for event in watch.push(START, faults)
    ]


def test_a_fault_is_told_once_when_it_comes_and_once_when_it_goes():
    watch = FaultReporter()
    assert told(watch) == []
    assert told(watch, ONE) == [("fault", "a", 1, 2, 17)]
    assert told(watch, replace(ONE, since=START + 5)) == []
    assert told(watch, ONE, ROW) == [("fault", "a", 1, None, None)]
    assert told(watch, ROW) == []
    assert told(watch) == [("mended", "a", 1, None, None)]


def test_what_becomes_part_of_a_larger_fault_is_not_over():
    for larger in (ROW, fault("column", column=2), PATCH):
        watch = FaultReporter()
        told(watch, ONE)
        place = ("fault", "a", larger.row, larger.column, None)
        assert told(watch, larger) == [place]
    for other in (fault("row", row=2), fault("patch", patch="b")):
        watch = FaultReporter()
        told(watch, ONE)
        assert ("mended", "a", 1, 2, 17) in told(watch, other)


@pytest.mark.parametrize(
    ("one", "text"),
    [
        (ONE, "taxel 17 (row 1, column 2) of patch 'a' is frozen at one count and is"),
        (ROW, "row 1 of patch 'a' is out and is left out; check its lines and plug"),
        (fault("column", column=0), "column 0 of patch 'a' is out and is left out"),
        (PATCH, "patch 'a' is out or silent and is left out"),
    ],
)
def test_a_fault_is_told_in_words(one, text):
    watch = FaultReporter()
    [begun], [over] = watch.push(START, [one]), watch.push(START, [])
    assert begun.text.startswith(text)
    assert over.text == text.split(" is ")[0] + " is in order again"


def test_a_stuck_taxel_is_an_event_of_the_stream():
    on = mounted()
    stream = scans(on, [], 25, 12.0)
    for scan in stream[100:]:
        scan.counts[5] = 1234
    listener, ear = (
        Recognition(recognizer(on), drop="never"),
        Ear(message_types=(Event,)),
    )
    with Stream(source_of(on, stream), [listener, ear]) as running:
        running.wait()
    assert [(e.kind, e.taxel) for e in ear.heard if e.taxel is not None] == [
        ("fault", 5)
    ]


# DurationHistogram.


def test_quantiles_are_those_of_all_durations_within_two_percent():
    rng = np.random.default_rng(5)
    values = np.exp(rng.normal(-7, 2, 20_000))
    durations = DurationHistogram()
    for value in values:
        durations.add(float(value))
    for share in (0.01, 0.5, 0.9, 0.99, 1.0):
        true = np.quantile(values, share, method="inverted_cdf")
        assert true * 0.999999 <= max(durations.quantile(share), 1e-6)
        assert durations.quantile(share) <= max(true, 1e-6) * 1.0201
    assert durations.longest == values.max()
    assert durations.count == len(values)


def test_durations_of_any_size_are_counted():
    durations = DurationHistogram()
    assert durations.quantile(0.5) == 0.0
    for value in (-1.0, 0.0, 1e9):
        durations.add(value)
    assert (durations.count, durations.longest) == (3, 1e9)
    assert durations.quantile(0.5) == 1e-6
