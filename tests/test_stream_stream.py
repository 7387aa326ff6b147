"""Tests of `Stream`: all listeners get everything, nobody waits, and all is closed."""

import signal
import subprocess
import sys
import textwrap
import threading
import time
from contextlib import contextmanager
from pathlib import Path

import pytest

from eskin.drivers import Event, Source
from eskin.errors import StreamError
from eskin.recording import read_recording
from eskin.stream import Stream, stop_on_signals
from eskin.touch import Scan
from helpers.streams import START, Ear, make_scans, played, same_scans

pytestmark = pytest.mark.slow

SCANS = make_scans(200)
EVENT = Event(START, "appeared", "patch 'a' is there")
SIGNALS = signal.SIGINT, signal.SIGTERM


@pytest.fixture(autouse=True)
def check_threads():
    """Check that a test leaves no thread behind."""
    before = set(threading.enumerate())
    yield
    assert set(threading.enumerate()) == before


@pytest.fixture
def release():
    """Return a flag for which listeners wait that hang."""
    flag = threading.Event()
    yield flag
    flag.set()


class WatchedSource(Source):
    """A played source that counts how often it is closed, and can raise or hang."""

    def __init__(self, scans=SCANS, before_read=lambda: None, events=()):
        self.inner = played(scans)
        self.info = self.inner.info
        self.clock = self.inner.clock
        self.before_read = before_read
        self.events = list(events)
        self.closed = 0

    def read(self, timeout=None):
        self.before_read()
        return self.inner.read(timeout)

    @property
    def ended(self):
        return self.inner.ended

    def take_events(self):
        events = self.events
        self.events = []
        return events

    def counters(self):
        return self.inner.counters()

    def close(self):
        self.closed += 1
        self.inner.close()


def raise_at(number, error):
    """Return a function that raises when it is called for that time."""
    calls = []

    def act(*_):
        calls.append(1)
        if len(calls) == number:
            raise error

    return act


def run_stream(source, listeners):
    with Stream(source, listeners) as stream:
        assert stream.wait()
    return stream


@contextmanager
def expect_failure(*parts):
    """Check that a stream fails with one line that holds some words in order."""
    with pytest.raises(StreamError, match=".*".join(parts)) as caught:
        yield caught
    assert "\n" not in str(caught.value)


def test_every_listener_gets_every_scan_on_its_own_thread():
    listeners = [Ear("a"), Ear("b", size=1), Ear("c", size=3)]
    stream = run_stream(played(SCANS), listeners)
    assert all(same_scans(listener.received, SCANS) for listener in listeners)
    assert [listener.closed for listener in listeners] == [1, 1, 1]
    for count in stream.queue_counts().values():
        assert (count.given, count.taken, count.dropped) == (200, 200, 0)
    assert stream.queue_counts()["b"].longest == 1
    threads = {listener.thread for listener in listeners}
    assert len(threads - {threading.current_thread()}) == 3
    assert all(thread.daemon for thread in threads)


def test_messages_come_to_listeners_of_their_type():
    both = Ear(message_types=(Scan, Event))
    events = Ear("e", message_types=(Event,))
    stream = run_stream(WatchedSource(events=[EVENT]), [both, events])
    # Events of a source come before the scan that they came with.
    assert both.received[0] == EVENT and same_scans(both.received[1:], SCANS)
    assert events.received == [EVENT]
    assert stream.queue_counts()["e"].given == 1


@pytest.mark.parametrize(("when", "count"), [("do", 200), ("close", 1)])
def test_message_of_a_listener_comes_to_all_others(when, count):
    talker = Ear("talker", message_types=(Scan, Event))
    other = Ear("other", message_types=(Event,))
    setattr(talker, when, lambda *_: talker.context.publish(EVENT))
    run_stream(played(SCANS), [talker, other])
    assert other.received == [EVENT] * count
    assert same_scans(talker.received, SCANS)


def test_stalled_listener_delays_nobody(release):
    stalled = threading.Event()
    done = threading.Event()
    slow = Ear("viewer", size=5, drop="oldest")
    slow.do = lambda scan: (stalled.set(), release.wait(20))
    fast = Ear("recognition", do=lambda scan: scan is SCANS[-1] and done.set())
    source = WatchedSource()
    source.before_read = lambda: not source.inner.given or stalled.wait(20)
    with Stream(source, [slow, fast]) as stream:
        assert done.wait(20)
        count = stream.queue_counts()["viewer"]
        assert (count.taken, count.waiting) == (1, 5)
        release.set()
        stream.wait()
    count = stream.queue_counts()["viewer"]
    assert same_scans(fast.received, SCANS)
    assert same_scans(slow.received[1:], SCANS[-5:])
    assert (count.given, count.taken, count.dropped) == (200, 6, 194)
    assert count.longest == 5


def test_listeners_of_one_name_are_refused():
    with pytest.raises(ValueError, match="ear, ear"):
        Stream(played(SCANS), [Ear(), Ear()])


def test_leaving_delivers_what_waits():
    source = WatchedSource(make_scans(2000))
    begun = threading.Event()
    listener = Ear(size=50, do=lambda scan: begun.set() or time.sleep(0.001))
    with Stream(source, [listener]) as stream:
        assert begun.wait(20) and not stream.wait(0.0)
    count = stream.queue_counts()["ear"]
    assert 0 < count.taken < 2000
    assert (count.dropped, count.waiting, count.given) == (0, 0, count.taken)
    assert (listener.closed, source.closed) == (1, 1)


@pytest.mark.parametrize("leave", [False, True])
@pytest.mark.parametrize("failing", [False, True])
def test_listeners_are_closed_in_order_then_the_source(failing, leave):
    log = []
    source = WatchedSource()
    listeners = [Ear("a"), Ear("b"), Ear("c")]
    for listener in listeners:
        listener.log = log
    source.close = lambda: log.append("source")
    if not failing:
        run_stream(source, listeners)
    else:
        listeners[1].do = raise_at(3, KeyError("no such touch"))
        with expect_failure("listener 'b'", "no such touch") as caught:
            with Stream(source, listeners) as stream:
                while leave and stream.failure is None:
                    time.sleep(0.001)
                if not leave:
                    stream.wait()
        assert isinstance(caught.value.__cause__, KeyError)
        assert len(listeners[1].received) == 2
    assert log == ["a", "b", "c", "source"]


def test_nothing_is_delivered_after_a_failure(release):
    slow = Ear("slow", do=lambda scan: release.wait(20))
    bad = Ear("bad", do=raise_at(50, KeyError("touch")))
    until = time.monotonic() + 20
    with expect_failure("bad"), Stream(WatchedSource(), [slow, bad]) as stream:
        while not stream.failure or stream.queue_counts()["slow"].waiting:
            assert time.monotonic() < until
            time.sleep(0.001)
        release.set()
    assert len(slow.received) <= 1
    assert stream.queue_counts()["slow"].dropped >= 49


def test_error_of_the_source_or_of_closing_stops_and_closes_all():
    source = WatchedSource(SCANS, raise_at(50, OSError("cable")))
    listener = Ear()
    with expect_failure("source sim:test", "cable"):
        run_stream(source, [listener])
    assert (listener.closed, source.closed) == (1, 1)
    assert len(listener.received) <= 49
    bad = Ear("bad")
    good = Ear("good")
    source = WatchedSource()
    bad.close = raise_at(1, OSError("stuck"))
    with expect_failure("listener 'bad'", "stuck"):
        run_stream(source, [bad, good])
    assert (good.closed, source.closed) == (1, 1)


def test_listener_that_cannot_start_closes_those_before_it():
    source = WatchedSource()
    good = Ear("good")
    bad = Ear("bad")
    bad.start = raise_at(1, ValueError("no port"))
    with pytest.raises(ValueError, match="no port"):
        run_stream(source, [good, bad])
    assert (good.closed, bad.closed, source.closed) == (1, 0, 1)
    assert good.received == []


def test_error_inside_with_is_raised_before_that_of_the_stream():
    bad = Ear(do=raise_at(1, KeyError("first")))
    with pytest.raises(ZeroDivisionError), Stream(played(SCANS), [bad]):
        raise ZeroDivisionError


@pytest.mark.parametrize(
    ("hanging", "size", "title"),
    [
        ("listener", 1000, "listener 'bad'"),
        ("listener", 1, "listener 'bad'"),
        ("source", 1000, "source sim:test"),
    ],
)
def test_listener_or_source_that_hangs_is_left_behind(release, hanging, size, title):
    def hang(*_):
        release.wait(20)

    source = WatchedSource(SCANS, hang if hanging == "source" else lambda: None)
    bad = Ear("bad", size=size)
    good = Ear("good")
    bad.do = hang if hanging == "listener" else bad.do
    stream = Stream(source, [bad, good], patience=0.5)
    with expect_failure(title, "0.5 s"), stream:
        stream.wait(0.1)
    assert (bad.closed, good.closed) == (hanging == "source", 1)
    release.set()
    stream.reader.join()
    for worker in stream.workers:
        worker.thread.join()
    assert source.closed == 1


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


def start_streaming(path, how):
    """Return a process that records a stream."""
    code = textwrap.dedent(STREAMING)
    tests = Path(__file__).parent
    child = subprocess.Popen(
        [sys.executable, "-c", code, path, how, tests],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert child.stdout.readline() == "streaming\n"
    return child


def test_first_signal_finishes_the_recording(tmp_path):
    path = tmp_path / "a.mcap"
    child = start_streaming(path, "well")
    child.send_signal(signal.SIGTERM)
    out, _ = child.communicate(timeout=30)
    recording = read_recording(path)
    assert child.returncode == 0 and not recording.truncated
    assert out == f"readings {recording.count}\n" and recording.count > 0
    assert len(list(tmp_path.iterdir())) == 1


def test_second_signal_kills(tmp_path):
    child = start_streaming(tmp_path / "a.mcap", "hang")
    while child.poll() is None:
        child.send_signal(signal.SIGINT)
        time.sleep(0.1)
    child.communicate(timeout=30)
    assert child.returncode == -signal.SIGINT


@pytest.mark.parametrize("number", SIGNALS)
def test_signal_stops_and_handlers_are_restored(number):
    def get_handlers():
        return [signal.getsignal(number) for number in SIGNALS]

    before = get_handlers()
    stopped = []
    seen = []
    with stop_on_signals(lambda: stopped.append(1)):
        signal.raise_signal(number)
        assert stopped == [1]
    assert get_handlers() == before

    def look():
        with stop_on_signals(lambda: None):
            seen.append(get_handlers())

    # Only the main thread may have handlers.
    thread = threading.Thread(target=look)
    thread.start()
    thread.join()
    assert seen == [before]
