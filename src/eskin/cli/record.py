"""`eskin record` guides a person through gestures of their own, and labels them."""

import queue
import sys
import threading
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from eskin.cli.checks import check_way, check_writable
from eskin.cli.guided import (
    Awaited,
    GuidedCommand,
    WaitReporter,
    open_guided_source,
    say,
)
from eskin.errors import RecordingError
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.cli.terminal import SkinPrinter
    from eskin.drivers import Source
    from eskin.recording import RecordingWriter
    from eskin.recording.guided import (
        AttemptEvent,
        AttemptReview,
        RecordingAttempt,
        RecordingGuide,
    )

MAX_GESTURES = 50
MAX_TIMES = 1000
KEYS = "a: again, the last one was wrong; s: skip the gesture; q: finish (then Enter)"
WITHOUT_KEYS = "Ctrl-C finishes, and keeps what was made"
"""Text in place of the keys where nobody can type them."""


@dataclass(frozen=True, kw_only=True)
class RecordCommand(GuidedCommand):
    """Record gestures of your own: make each when it is asked for, and it is labelled.

    Keep your hands off at first. A gesture is over when nothing has touched the skin
    for a pause, 0.36 s. `none` is what you do to the robot without meaning anything:
    lean, brush past, rest a hand. It ends with the command that trains on it.
    """

    source: tyro.conf.Positional[tuple[str, ...]]
    """Device, serial:PATH or csv:PATH (one or several), udp://HOST:PORT or
    xela://HOST:PORT; or replay:FILE, a recording of the gestures in the order in which
    they are asked for."""

    out: Path
    """Path of the recording to write (.mcap), a new one."""

    gestures: tuple[str, ...]
    """Names of the gestures, best with `none` among them, for no gesture."""

    times: int = 10
    """Number of times that each is asked for, in turns."""

    person: str = ""
    """Name of the person, so that people can be told apart when scoring."""

    session: str = ""
    """Name of the session."""


def run(command: RecordCommand) -> dict[str, object]:
    """Record until every gesture was made often enough, and return what there is."""
    from eskin.cli.terminal import SkinPrinter
    from eskin.recording import Metadata, RecordingWriter
    from eskin.recording.guided import RecordingGuide, review_attempts
    from eskin.skin import describe_robot

    check_options(command)
    with ExitStack() as stack:
        source, mounted = open_guided_source(command, stack)
        info = source.info
        gestures = command.gestures
        guide = RecordingGuide(mounted, info.calibration, gestures, command.times)
        printer = SkinPrinter(info.skin)
        writer = stack.enter_context(
            RecordingWriter(
                command.out,
                info.robot_name,
                info.skin,
                info.calibration,
                Metadata("recorded", command.person, command.session),
                info.joint_names,
                describe_robot(info.mounted.robot).urdf,
            )
        )
        labels = LabelWriter(writer)
        with suppress(KeyboardInterrupt):
            record_attempts(source, guide, writer, printer, labels)
        printer.finish()
        labels.write(guide.attempts)
        if not guide.attempts:
            raise RecordingError(
                f"{info.uri} had no gesture; allowed is one or more; touch the skin "
                f"when asked to; its scans are kept in {writer.part}"
            )
    review = review_attempts(guide.attempts, command.gestures)
    for line in describe_review(review, command):
        say(line)
    return {
        "out": str(command.out),
        "takes": review.counts,
        "nearest_right": review.nearest_right,
        "few": list(review.few),
    }


def check_options(command: RecordCommand) -> None:
    """Raise if an option is out of range, or the file cannot be written.

    Raises:
        ValueError: for an option.
        EskinError: for the file.
    """
    from eskin.recording import check_gesture_names, check_new_recording

    names = command.gestures
    if not 2 <= len(names) <= MAX_GESTURES or len(set(names)) < len(names):
        raise ValueError(
            f"--gestures are {', '.join(names) or 'not given'}; allowed are 2 to "
            f"{MAX_GESTURES} different names; add none, for touches without meaning"
        )
    try:
        check_gesture_names(names)
    except RecordingError as error:
        raise ValueError(f"--gestures: {error}") from None
    if not 1 <= command.times <= MAX_TIMES:
        raise ValueError(f"--times is {command.times}; allowed are 1 to {MAX_TIMES}")
    check_new_recording(command.out)
    check_writable(command.out)


def record_attempts(
    source: "Source",
    guide: "RecordingGuide",
    writer: "RecordingWriter",
    printer: "SkinPrinter",
    labels: "LabelWriter",
) -> None:
    """Write scans until every gesture has its attempts, and say what to do.

    The label of an attempt is written when the next one is complete, since it may be
    dropped or go on until then.
    """
    keys = listen_to_keys()
    needs = f"a touch has {guide.pipeline.contact:.2g} kPa or more"
    waiting = WaitReporter(guide.mounted.skin, needs)
    is_typed = sys.stdin.isatty()
    say(f"hands off for a moment; {KEYS if is_typed else WITHOUT_KEYS}")
    for scan in source:
        writer.write(scan)
        event = guide.push(scan)
        if guide.state is not None:
            check_way(guide.state.faults)
            printer.print_reading(scan.stamp, guide.state.faults, source.take_events())
            say(waiting.describe_wait(guide.state, find_awaited(guide)))
        if event is not None:
            labels.write(guide.attempts[:-1])
            say(describe_event(event))
            # The next request was made when the attempt that went on was taken first.
            is_asked = event.goes_on and event.attempt is not None
            if event.kind not in ("began", "touched") and not is_asked:
                say(describe_request(guide))
        while not keys.empty():
            obey_key(keys.get(), guide)
        if guide.is_over:
            return


def find_awaited(guide: "RecordingGuide") -> Awaited:
    """Find what a person is waited for now."""
    if not guide.is_ready:
        return "rest"
    return None if guide.touch is not None or guide.request is None else "touch"


class LabelWriter:
    """Writes the label of each attempt once, in their order."""

    def __init__(self, writer: "RecordingWriter") -> None:
        """Start without a label in a recording."""
        self.writer = writer
        self.count = 0

    def write(self, attempts: "Sequence[RecordingAttempt]") -> None:
        """Write the labels of the attempts so far that are not written yet."""
        for attempt in attempts[self.count :]:
            self.writer.write_label(attempt.label)
            self.count += 1


def listen_to_keys() -> "queue.SimpleQueue[str]":
    """Return the lines that are typed in a terminal from now on; none without one."""
    typed: queue.SimpleQueue[str] = queue.SimpleQueue()
    if sys.stdin.isatty():

        def read() -> None:
            for line in sys.stdin:
                typed.put(line.strip().lower())

        threading.Thread(target=read, daemon=True).start()
    return typed


def obey_key(key: str, guide: "RecordingGuide") -> None:
    """Do what was typed."""
    if key == "a":
        dropped = guide.again()
        say("nothing to repeat" if dropped is None else f"{dropped.gesture} is dropped")
    elif key == "s":
        say(f"{guide.request} is left out")
        guide.skip()
    elif key == "q":
        guide.skipped.update(guide.gestures)
    elif key:
        say(f"'{key}' is no key; allowed are {KEYS}")
    say(describe_request(guide))


def describe_request(guide: "RecordingGuide") -> str:
    """Describe which gesture to make now; empty where none is missing."""
    gesture = guide.request
    if not guide.is_ready or gesture is None:
        return ""
    return (
        f"{gesture} ({guide.count_attempts(gesture) + 1} of {guide.times}): touch now"
    )


def describe_event(event: "AttemptEvent") -> str:
    """Describe what a scan has led to; empty where there is nothing to say."""
    if event.kind == "touched":
        return f"{event.text}: hands off, rest begins again"
    if event.kind == "refused":
        return f"  not used: {event.text}"
    attempt = event.attempt
    if attempt is None:
        return ""
    went_on = "it went on: " if event.goes_on else ""
    text = (
        f"  {went_on}{attempt.seconds:.2f} s, {attempt.force:.1f} N, "
        f"{format_count(attempt.taxels, 'taxel')}"
    )
    if attempt.saturated:
        text += f", {attempt.saturated} of them at full scale"
    return text


def describe_review(review: "AttemptReview", command: RecordCommand) -> list[str]:
    """Describe what was recorded and what misses, in lines."""
    counts = ", ".join(f"{count} of {name}" for name, count in review.counts.items())
    total = sum(review.counts.values())
    lines = [
        f"written to {command.out}: {counts}",
        f"{review.nearest_right} of {total} are most like another of their own gesture",
    ]
    if review.confused is not None:
        one, other, times = review.confused
        lines.append(f"  {one} is most like {other} {format_count(times, 'time')}")
    if review.few:
        lines.append(f"  few examples of {', '.join(review.few)}; record more of them")
    from eskin.live.model_file import MODEL_SUFFIX

    model = command.out.with_suffix(MODEL_SUFFIX)
    lines.append(
        f"then: eskin train {command.out} --start ur5 --train.epochs 3 --out {model}"
    )
    return lines
