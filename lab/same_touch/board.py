"""This module serves a page that compares two recognisers on the same touch."""

from collections.abc import Callable, Iterator, Sequence
from itertools import cycle
from typing import final

import numpy as np

from eskin.drivers import PlayedSource, SourceInfo
from eskin.live import Model, Recognizer, warm_up
from eskin.page import Answer, ComparisonBoard
from eskin.page.process import free_port
from eskin.page.viewer import Viewer, ViewerConfig
from eskin.sim.demo.headless import DemoConfig
from eskin.stream import (
    Context,
    Listener,
    Message,
    Recognition,
    Stream,
    short_switch_interval,
    stop_on_signals,
)
from eskin.stream.listener import Drop
from eskin.touch import Scan
from eskin.units import NS_PER_S
from lab.same_touch.touches import (
    RecognitionResult,
    RecognitionRun,
    SameTouch,
    draw_touches,
    load_both_models,
)

POSE_TITLES = ("patches folded together", "the same patches apart")
MODEL_TITLES = ("sees the pose", "never sees the pose")


@final
class ComparisonListener(Listener):
    """Feeds each playback of a touch to fresh recognisers of both models.

    Attributes:
        board: their results for the page; None before the first playback.
    """

    name = "comparison"
    message_types = (Scan,)
    size = 512
    drop: Drop = "oldest"

    def __init__(
        self, touches: Sequence[SameTouch], models: tuple[Model, Model]
    ) -> None:
        """Compare two models on the touches that are played."""
        self.touches = touches
        self.models = models
        self.length = touches[0].period * len(touches[0].counts)
        self.begin: int | None = None
        self.playback = -1
        self.runs: list[tuple[RecognitionRun, ...]] = []
        self.board: ComparisonBoard | None = None

    def start(self, context: Context) -> None:
        """Do nothing."""

    def on_message(self, item: Message) -> None:
        """Feed a scan to both recognisers."""
        if not isinstance(item, Scan):
            return
        self.begin = item.stamp if self.begin is None else self.begin
        playback = (item.stamp - self.begin) // self.length
        if playback != self.playback:
            self.start_playback(playback)
        for run in self.runs[-1]:
            run.push(item)
        self.board = self.build_board()

    def start_playback(self, playback: int) -> None:
        """Start the next playback with fresh recognisers."""
        self.finish()
        self.playback = playback
        if playback % 2 == 0:
            self.runs = []
        touch = self.touch
        self.runs.append(tuple(RecognitionRun(model, touch) for model in self.models))

    @property
    def touch(self) -> SameTouch:
        """Return the touch that is played now."""
        return self.touches[self.playback // 2 % len(self.touches)]

    def finish(self) -> None:
        """End the present playback."""
        for run in self.runs[-1] if self.runs else ():
            run.finish()

    def build_board(self) -> ComparisonBoard:
        """Build the board of the results in both poses so far."""
        labels, classes = self.touch.labels, len(self.models[0].card.vocabulary)
        results = [[run.result for run in side] for side in self.runs]
        results += [[None, None]] * (2 - len(results))
        rows = tuple(
            (title, tuple(map(format_result, both, labels, (classes, classes))))
            for title, both in zip(
                MODEL_TITLES, zip(*results, strict=True), strict=True
            )
        )
        number = self.playback // 2 % len(self.touches) + 1
        title = f"The same counts twice: touch {number}"
        return ComparisonBoard(title, POSE_TITLES, labels, len(self.runs) - 1, rows)

    def close(self) -> None:
        """End the last playback."""
        self.finish()


def format_result(result: RecognitionResult | None, label: str, classes: int) -> Answer:
    """Format a result for the page; None stands for a playback still to come."""
    if result is None:
        return Answer((), None, np.zeros(classes, np.float32))
    correct = result.is_correct(label) if result.detected else None
    return Answer(result.texts, correct, result.probabilities.astype(np.float32))


def play_touches(touches: Sequence[SameTouch]) -> Iterator[Scan]:
    """Yield the scans of one touch after the other in both poses, without end."""
    begin, come_from = touches[0].period, touches[-1].poses[1]
    for touch in cycle(touches):
        for side in (0, 1):
            yield from touch.scans(side, begin, come_from)
            begin += touch.period * len(touch.counts)
            come_from = touch.poses[side]


def serve_same_touch(
    config: DemoConfig,
    number: int,
    port: int,
    seconds: float | None,
    tell: Callable[[str], None],
) -> dict[str, int]:
    """Serve the page until time is up or a signal comes.

    Args:
        config: skin, model and build.
        number: number of touches to play in turn.
        port: port of the page on this computer; 0 for any free one.
        seconds: how long to serve [s]; without end if None.
        tell: prints a line for the user.

    Returns:
        The number of readings given.

    Raises:
        DeviceError: the port is not available.
        StreamError: something failed while it ran.
    """
    port = free_port(port)
    models = load_both_models(config.model)
    touches = draw_touches(number, config.skin, config.build_kind, config.seed)
    mounted, calibration = touches[0].mounted, touches[0].calibration
    recognizer = Recognizer(models[0], mounted, calibration)
    warm_up(recognizer)
    comparison = ComparisonListener(touches, models)
    recognition = Recognition(recognizer)
    page = ViewerConfig(port)
    viewer = Viewer(recognition, page, board=lambda: comparison.board)
    rate = NS_PER_S / touches[0].period
    info = SourceInfo.build("sim:same-touch", mounted, calibration, rate)
    source = PlayedSource(info, play_touches(touches), restamp=True)
    stream = Stream(source, [recognition, comparison, viewer])
    with stop_on_signals(stream.stop), short_switch_interval(), stream:
        tell(f"Ctrl-C ends it; see {page.link}")
        stream.wait(seconds)
    return {"readings": source.given}
