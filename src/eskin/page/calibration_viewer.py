"""This module shows a calibration in the browser while a person is guided."""

from dataclasses import replace
from threading import Event as Flag
from time import monotonic
from typing import final

from eskin.errors import DeviceError
from eskin.page.appearance import describe_scene
from eskin.page.messages import (
    GuideBoard,
    LogEntry,
    Order,
    PageOrder,
)
from eskin.page.process import PageProcess
from eskin.page.viewer import (
    MAX_UPDATE_RATE,
    FrameEncoder,
    ViewerConfig,
)
from eskin.skin import MountedSkin
from eskin.stream import RecognitionState
from eskin.touch import TouchState

TICK = 0.1
"""Interval between checks of the page's process [s]."""


@final
class CalibrationViewer:
    """Shows a calibration in the browser, and stores what the person clicks there.

    Attributes:
        opened: flag set once a browser has opened the page.
        closed: flag set once the person has closed it by its button.
        skipped: patch or point that the person wants to leave out; None where nothing
            is to be left out.
        repeated: number of presses of which the person wants to repeat the last; None
            where nothing is to be repeated.
    """

    def __init__(
        self, mounted: MountedSkin, rate: float, config: ViewerConfig | None = None
    ) -> None:
        """Start the page's process.

        Args:
            mounted: skin that is calibrated, on its robot.
            rate: rate of the scans [1/s].
            config: configuration of the page; nothing can be touched there.

        Raises:
            DeviceError: the port is not available.
        """
        config = config or ViewerConfig()
        self.rate = rate
        self.opened, self.closed = Flag(), Flag()
        self.skipped: str | None = None
        self.repeated: int | None = None
        self.encoder: FrameEncoder | None = None
        self.mounted, self.stamp, self.due = mounted, 0, 0.0
        scene = describe_scene(mounted, (), calibrates=True, warning=config.warning)
        self.page = PageProcess(scene, config.port, self.take_order, config.token)

    def take_order(self, order: Order) -> None:
        """Store what the person has clicked."""
        if not isinstance(order, PageOrder):
            return
        match order.kind:
            case "opened":
                self.opened.set()
            case "skip":
                self.skipped = str(order.value)
            case "again":
                self.repeated = int(order.value or 0)
            case "close":
                self.closed.set()

    @property
    def is_opened(self) -> bool:
        """Return whether a browser has opened the page.

        Raises:
            DeviceError: the page cannot be served.
        """
        if self.page.failure is not None and not self.opened.is_set():
            raise DeviceError(self.page.failure)
        return self.opened.is_set()

    def wait_opened(self) -> None:
        """Wait until a browser has opened the page.

        Raises:
            DeviceError: the page cannot be served.
        """
        while not self.is_opened:
            self.opened.wait(TICK)

    def wait_closed(self) -> None:
        """Wait until the person has closed the page, or its process has ended."""
        while self.page.failure is None and not self.closed.wait(TICK):
            pass

    def wants(self) -> bool:
        """Return whether the page is to be given the latest scan."""
        return monotonic() >= self.due and self.page.wants()

    def tell(self, line: str) -> None:
        """Add a line to the log of the page."""
        if self.encoder is not None:
            seconds = self.encoder.seconds(self.stamp)
            entry = LogEntry(seconds, "event", line.strip())
            self.encoder.log_entries.append(entry)

    def show(self, state: TouchState, board: GuideBoard) -> None:
        """Show pressures and contacts of a scan, and what to do next."""
        self.stamp = state.reading.stamp
        if self.encoder is None:
            self.encoder = FrameEncoder(self.mounted, self.stamp)
        self.due = monotonic() + 1 / MAX_UPDATE_RATE
        recognised = RecognitionState(state, {}, ())
        update = self.encoder.build_update(recognised, self.rate, 0.0, 0.0, None)
        self.page.give(replace(update, guide=board))

    def close(self) -> None:
        """End the page's process."""
        self.page.close()
