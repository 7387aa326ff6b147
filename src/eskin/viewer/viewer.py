"""The browser view as a listener."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from time import monotonic
from typing import Protocol, final, runtime_checkable

from eskin.errors import DeviceError
from eskin.page import Board, Order, Setup
from eskin.skin import MountedSkin
from eskin.stream import Context, Listener, Message, Recognition, RecognitionState
from eskin.stream.listener import RARE, Drop
from eskin.units import NS_PER_S
from eskin.viewer.look import setup_of
from eskin.viewer.packer import ArmTold, Packer, arm_line
from eskin.viewer.process import PageProcess

PICTURES = 25.0
"""A second, at most [1/s]."""


@runtime_checkable
class HasState(Protocol):
    """An arm, as far as the page needs one."""

    def state(self) -> ArmTold:
        """How it is now."""
        ...


@dataclass(frozen=True)
class ViewerConfig:
    """How the page is served, and what people may do in it."""

    port: int = 8080
    """Of 127.0.0.1; 0 for any free one."""

    touchable: bool = False
    """Whether touches and other orders are taken from the page. Never with a real
    robot, unless its owner says so."""

    skins: tuple[str, ...] = ()
    """Skins that can be chosen; the first is on."""


@final
class Viewer(Listener):
    """Shows a stream in the browser, and gives back what people do there.

    The page lives in a process of its own. This one only packs a picture 25 times a
    second, and not even that while the page has not shown those before.

    Attributes:
        page: the process; None before the start and after the end.
    """

    name = "viewer"
    message_types = (RecognitionState, *RARE)
    size = 64
    drop: Drop = "oldest"

    def __init__(
        self,
        recognition: Recognition,
        config: ViewerConfig | None = None,
        obey: Callable[[Order], None] | None = None,
        arm: HasState | None = None,
        board: Callable[[], Board | None] | None = None,
    ) -> None:
        """Nothing is started before the stream is.

        Args:
            recognition: that tells the moments.
            config: how the page is served.
            obey: is called on a thread of its own with each order that people give.
            arm: whose state is shown.
            board: tells what recognisers that are compared say, which is then shown
                in place of all else beside the scene.
        """
        self.recognition = recognition
        self.config = config or ViewerConfig()
        self.obey = obey
        self.arm = arm
        self.board = board
        self.page: PageProcess | None = None
        self.due = self.counted_from = 0.0
        self.count, self.rate = 0, 0.0

    @property
    def mounted(self) -> MountedSkin:
        """The skin that is seen."""
        return self.recognition.recognizer.mounted

    def start(self, context: Context) -> None:
        """Start the page's process.

        Raises:
            DeviceError: the port cannot be had.
        """
        self.context = context
        self.packer = Packer(self.mounted, context.clock.now())
        self.page = PageProcess(self.setup(), self.config.port, self.obey)

    def setup(self) -> Setup:
        """What the page is told once."""
        return setup_of(
            self.mounted,
            self.recognition.recognizer.model.card.vocabulary,
            touchable=self.config.touchable,
            skins=self.config.skins,
            is_arm=self.arm is not None,
            compares=self.board is not None,
        )

    def on_message(self, item: Message) -> None:
        """Keep what is said; of moments show one in 40 ms."""
        if not isinstance(item, RecognitionState):
            self.packer.note(item)
            return
        now = monotonic()
        self.count_up(self.context.clock.now() / NS_PER_S)
        if now < self.due or self.page is None or not self.page.wants():
            return
        self.due = max(self.due + 1 / PICTURES, now)
        step, stamp = self.recognition.step.quantile(0.5), item.state.reading.stamp
        arm = None if self.arm is None else arm_line(self.arm.state())
        age = self.context.age(stamp)
        picture = self.packer.picture(item, self.rate, step, age, arm)
        board = None if self.board is None else self.board()
        self.page.give(replace(picture, board=board))

    def count_up(self, now: float) -> None:
        """Measure the rate of readings once a second."""
        self.count += 1
        elapsed = now - self.counted_from
        if elapsed >= 1.0:
            self.rate = self.count / elapsed if self.counted_from else 0.0
            self.count, self.counted_from = 0, now

    def wait_ready(self, timeout: float) -> int:
        """Wait until the page is served, once the stream has started; its port.

        Args:
            timeout: how long at most [s].

        Raises:
            DeviceError: it is not served.
        """
        if self.page is None:
            raise DeviceError(
                "there is no page; allowed is a viewer of a running stream; start it"
            )
        return self.page.wait_ready(timeout)

    def close(self) -> None:
        """End the page's process."""
        if self.page is not None:
            self.page.close()
            self.page = None
