"""The same touch in two poses in the browser, and what two recognisers say of it."""

from collections.abc import Callable, Iterator, Sequence
from itertools import cycle
from typing import final

import numpy as np

from eskin.demo.headless import DemoConfig
from eskin.demo.same_touch import (
    RecognitionResult,
    RecognitionRun,
    SameTouch,
    draw_touches,
    load_both_models,
)
from eskin.drivers import SourceInfo
from eskin.drivers.played_source import PlayedSource
from eskin.live import Recognizer, warm_up
from eskin.model import Model
from eskin.page import Answer as Shown
from eskin.page import Board
from eskin.page.port import free_port
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
from eskin.viewer import Viewer, ViewerConfig

POSES = ("patches folded together", "the same patches apart")
WHO = ("sees the pose", "never sees the pose")


@final
class ComparisonListener(Listener):
    """Hears each playing with recognisers that have heard nothing before.

    Attributes:
        board: what they say; None before the first playing.
    """

    name = "comparison"
    message_types = (Scan,)
    size = 512
    drop: Drop = "oldest"

    def __init__(
        self, touches: Sequence[SameTouch], models: tuple[Model, Model]
    ) -> None:
        """Compare two models on what is played."""
        self.touches = touches
        self.models = models
        self.length = touches[0].period * len(touches[0].counts)
        self.begin: int | None = None
        self.playing = -1
        self.opinions: list[tuple[RecognitionRun, ...]] = []
        self.board: Board | None = None

    def start(self, context: Context) -> None:
        """Nothing needs to be made ready."""

    def on_message(self, item: Message) -> None:
        """Let both hear a scan."""
        if not isinstance(item, Scan):
            return
        self.begin = item.stamp if self.begin is None else self.begin
        playing = (item.stamp - self.begin) // self.length
        if playing != self.playing:
            self.turn_to(playing)
        for opinion in self.opinions[-1]:
            opinion.on_message(item)
        self.board = self.board_now()

    def turn_to(self, playing: int) -> None:
        """Begin to hear the next playing, with nothing said of it yet."""
        self.finish()
        self.playing = playing
        if playing % 2 == 0:
            self.opinions = []
        touch = self.touch
        self.opinions.append(
            tuple(RecognitionRun(model, touch) for model in self.models)
        )

    @property
    def touch(self) -> SameTouch:
        """What is played now."""
        return self.touches[self.playing // 2 % len(self.touches)]

    def finish(self) -> None:
        """End the playing under way."""
        for opinion in self.opinions[-1] if self.opinions else ():
            opinion.finish()

    def board_now(self) -> Board:
        """What was said in either pose so far."""
        labels, classes = self.touch.labels, len(self.models[0].card.vocabulary)
        answers = [[opinion.answer for opinion in side] for side in self.opinions]
        answers += [[None, None]] * (2 - len(answers))
        rows = tuple(
            (who, tuple(map(shown, said, labels, (classes, classes))))
            for who, said in zip(WHO, zip(*answers, strict=True), strict=True)
        )
        number = self.playing // 2 % len(self.touches) + 1
        title = f"The same counts twice: touch {number}"
        return Board(title, POSES, labels, len(self.opinions) - 1, rows)

    def close(self) -> None:
        """End the last playing."""
        self.finish()


def shown(answer: RecognitionResult | None, label: str, classes: int) -> Shown:
    """An answer as the page shows it; None is one that is still to come."""
    if answer is None:
        return Shown((), None, np.zeros(classes, np.float32))
    right = answer.is_right(label) if answer.said else None
    return Shown(answer.words, right, answer.probabilities.astype(np.float32))


def played(touches: Sequence[SameTouch]) -> Iterator[Scan]:
    """One touch after the other in both of its poses, without end."""
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
    """Serve the page until it is over, or a signal comes.

    Args:
        config: what is demonstrated.
        number: of touches that are played in turn.
        port: of the page on this computer; 0 for any free one.
        seconds: when to stop; never where None.
        tell: is told what there is to tell the person at the terminal.

    Returns:
        How many readings were given.

    Raises:
        DeviceError: the port cannot be had.
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
    viewer = Viewer(recognition, ViewerConfig(port), board=lambda: comparison.board)
    info = SourceInfo(
        uri="sim:same-touch",
        robot_name=mounted.robot.name,
        joint_names=mounted.robot.joint_names,
        skin=mounted.skin,
        calibration=calibration,
        rate=NS_PER_S / touches[0].period,
    )
    source = PlayedSource(info, played(touches), restamp=True)
    stream = Stream(source, [recognition, comparison, viewer])
    with stop_on_signals(stream.stop), short_switch_interval(), stream:
        tell(f"see http://127.0.0.1:{port}; Ctrl-C ends it")
        stream.wait(seconds)
    return {"readings": source.given}
