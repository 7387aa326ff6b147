"""The demonstration in the browser."""

import gc
import logging
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from threading import Event as Flag
from threading import Lock
from typing import final

import numpy as np

from eskin.command import (
    Policy,
    PolicyConfig,
    SimulatedArm,
    SkinMonitorConfig,
    load_commands,
)
from eskin.demo.headless import DemoConfig, build_arm
from eskin.demo.live_source import LiveSource
from eskin.drivers import Clock, Event, HostClock
from eskin.errors import EskinError
from eskin.live import Detection, Recognizer, warm_up
from eskin.model import load_model
from eskin.page import Order, PageOrder, TouchOrder
from eskin.page.port import free_port
from eskin.recording import Metadata
from eskin.sim.interactive.hand import Place
from eskin.sim.interactive.skin import LiveSkin
from eskin.stream import (
    Context,
    Listener,
    Message,
    Recognition,
    Recorder,
    Stream,
    short_switch_interval,
    stop_on_signals,
)
from eskin.stream.listener import Drop
from eskin.touch import Scan
from eskin.viewer import Viewer, ViewerConfig


@final
class RecordButton(Listener):
    """Records from `press` to `lift`, each time into another file."""

    name = "record button"
    message_types = (Scan, Detection, Event)
    size = 2000
    drop: Drop = "newest"

    def __init__(self, folder: Path, metadata: Metadata) -> None:
        """Record nothing yet.

        Args:
            folder: that recordings go to.
            metadata: of all of them.
        """
        self.folder = folder
        self.metadata = metadata
        self.recorder: Recorder | None = None
        self.lock = Lock()

    def start(self, context: Context) -> None:
        """Remember the stream."""
        self.context = context

    def press(self) -> None:
        """Begin a recording; one that goes on goes on.

        Raises:
            RecordingError: it cannot be written.
        """
        with self.lock:
            if self.recorder is None:
                name = time.strftime("touches-%Y%m%d-%H%M%S.mcap")
                recorder = Recorder(self.folder / name, self.metadata)
                recorder.start(self.context)
                self.recorder = recorder

    def lift(self) -> None:
        """Finish the recording, if there is one."""
        with self.lock:
            recorder, self.recorder = self.recorder, None
            if recorder is not None:
                recorder.close()

    def on_message(self, item: Message) -> None:
        """Write it while recording."""
        with self.lock:
            if self.recorder is not None:
                self.recorder.on_message(item)

    def close(self) -> None:
        """Finish the recording, if there is one."""
        self.lift()


@final
class PageCommandHandler:
    """Turns the orders of a page into touches of simulated fingers, and the rest.

    A touch goes through the same hand, contact and sensor as the training data: the
    recogniser hears nothing of what it was meant to be.
    """

    def __init__(
        self,
        skin: LiveSkin,
        arm: SimulatedArm,
        other: Callable[[PageOrder], None] = lambda order: None,
    ) -> None:
        """Obey from now on.

        Args:
            skin: that is touched.
            arm: that is paused, and unlocked as at the robot.
            other: obeys what is neither touch nor fault nor pause.
        """
        self.skin = skin
        self.arm = arm
        self.other = other
        self.dragged: dict[int, int] = {}

    def obey(self, order: Order) -> None:
        """Do what is asked for."""
        if isinstance(order, TouchOrder):
            self.touch(order)
        else:
            self.do(order)

    def touch(self, order: TouchOrder) -> None:
        """Touch the skin."""
        hand = self.skin.hand
        place = Place(order.link, np.array(order.p_link, np.float64))
        match order.kind:
            case "poke":
                hand.poke(place, order.force, order.seconds)
            case "double_pat":
                hand.double_pat(place, order.force, order.seconds)
            case "grab":
                hand.grab(place, order.force, order.seconds)
            case "begin":
                self.dragged[order.key] = hand.begin(place, order.force)
            case "move":
                if order.key in self.dragged:
                    hand.move(self.dragged[order.key], place)
            case "end":
                if order.key in self.dragged:
                    hand.end(self.dragged.pop(order.key))

    def do(self, order: PageOrder) -> None:
        """Do something else."""
        match order.kind:
            case "unplug":
                self.skin.unplug(str(order.value))
            case "plug":
                self.skin.plug(str(order.value))
            case "kill":
                self.skin.kill(float(order.value or 0.0))
            case "restore":
                self.skin.restore()
            case "pause_task":
                self.arm.pause()
            case "resume_task":
                self.arm.unlock()
                self.arm.release()
                self.arm.resume()
            case _:
                self.other(order)


SKINS = ("ur5", "ur5-half", "ur5-double", "ur5-shapes", "ur5-missing")
"""That fit the arm which is shown."""

PATIENT = SkinMonitorConfig(max_age=0.4)
"""The same computer simulates the skin and draws the page: a simulated arm may wait
longer for a reading than a real one."""

READY = 60.0
"""How long a page may take to be served [s]."""

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class PageResult:
    """What came of a page that was served."""

    readings: int
    """Scans that were recognised."""
    detections: int
    """What was said of touches."""
    commands: int
    """Commands that were obeyed."""
    step: tuple[float, float]
    """Time of a step, p50 and p99 [ms]."""


def serve(
    config: DemoConfig,
    port: int,
    seconds: float | None = None,
    tell: Callable[[str], None] = lambda line: None,
) -> PageResult:
    """Serve the page until it is over, or a signal comes.

    Args:
        config: what is demonstrated first; the skin can be changed in the page.
        port: of the page on this computer; 0 for any free one.
        seconds: when to stop; never where None.
        tell: is told what there is to tell the person at the terminal.

    Raises:
        DeviceError: the port cannot be had.
        StreamError: something failed while it ran.
    """
    port = free_port(port)
    while True:
        wanted = SkinChoice()
        served = serve_skin(config, port, seconds, tell, wanted)
        if wanted.skin is None:
            return served
        config = replace(config, skin=wanted.skin)


@dataclass(frozen=True, eq=False)
class RunningDemo:
    """A page that is served, and what is behind it."""

    port: int
    """Of the page."""
    arm: SimulatedArm
    """At its task."""
    source: LiveSource
    """The skin on the arm."""
    recognition: Recognition
    """Of its touches."""
    policy: Policy
    """By which they command the arm."""
    stream: Stream
    """From the one to the other."""


class SkinChoice:
    """A skin that was chosen in the page, which the stream is begun anew for; final."""

    def __init__(self) -> None:
        """None is chosen."""
        self.skin: str | None = None
        self.stop: Callable[[], None] = Flag().set

    def choose(self, skin: str) -> None:
        """Stop the stream for another skin."""
        self.skin = skin
        self.stop()


def serve_skin(
    config: DemoConfig,
    port: int,
    seconds: float | None,
    tell: Callable[[str], None],
    wanted: SkinChoice,
) -> PageResult:
    """Serve the page with one skin."""
    with running(config, port, wanted) as demo:
        tell(f"see http://127.0.0.1:{demo.port}; Ctrl-C ends it")
        demo.stream.wait(seconds)
    step = demo.recognition.step
    return PageResult(
        demo.source.given,
        demo.recognition.detections,
        demo.policy.accepted,
        (1e3 * step.quantile(0.5), 1e3 * step.quantile(0.99)),
    )


@contextmanager
def running(
    config: DemoConfig, port: int, wanted: SkinChoice, clock: Clock | None = None
) -> Iterator[RunningDemo]:
    """Have one skin on its arm served; signals stop its stream.

    Args:
        config: what is demonstrated.
        port: of the page on this computer; 0 for any free one.
        wanted: is told of another skin that is chosen in the page.
        clock: that arm and skin go by; this computer's unless given.

    Raises:
        DeviceError: the port cannot be had.
        StreamError: something failed while it ran.
    """
    model = load_model(config.model)
    skin = LiveSkin(config.skin, config.seed, config.build_kind, loses=False)
    recognizer = Recognizer(model, skin.mounted, skin.calibration)
    warm_up(recognizer)
    warm_up_hand(config)
    skins = (config.skin, *(name for name in SKINS if name != config.skin))
    vocabulary, clock = model.card.vocabulary, clock or HostClock()
    commands = load_commands(config.commands, vocabulary, skin.mounted.skin)
    with build_arm(config, clock) as arm:
        recognition = Recognition(recognizer)
        policy = Policy(arm, commands, vocabulary, PolicyConfig(monitor=PATIENT))
        button = RecordButton(Path.cwd(), Metadata("demo", "mouse", "browser"))
        obedience = PageCommandHandler(
            skin, arm, lambda order: do(order, button, wanted)
        )
        page = ViewerConfig(port, touchable=True, skins=skins)
        viewer = Viewer(recognition, page, guarded(obedience.obey), arm)
        source = LiveSource(
            skin, arm, clock, after_scan=lambda: arm.apply_wrenches(skin.wrenches)
        )
        gc.unfreeze()
        gc.collect()
        gc.freeze()
        stream = Stream(source, [recognition, policy, viewer, button])
        wanted.stop = stream.stop
        with stop_on_signals(stream.stop), short_switch_interval(), stream:
            port = viewer.wait_ready(READY)
            yield RunningDemo(port, arm, source, recognition, policy, stream)


def warm_up_hand(config: DemoConfig) -> None:
    """Load all compiled code that a live skin and a touch need, on another skin."""
    skin = LiveSkin(config.skin, config.seed, config.build_kind, loses=False)
    q = np.zeros(len(skin.mounted.robot.joint_names))
    for number in range(40):
        if number == 5:
            skin.hand.perform("poke")
        skin.scan(number + 1, q)


def do(order: PageOrder, button: RecordButton, wanted: SkinChoice) -> None:
    """Record, or put on another skin."""
    match order.kind:
        case "record":
            button.press()
        case "stop_recording":
            button.lift()
        case "skin":
            wanted.choose(str(order.value))


def guarded(obey: Callable[[Order], None]) -> Callable[[Order], None]:
    """The same, where what cannot be done is only said."""

    def obey_or_say(order: Order) -> None:
        try:
            obey(order)
        except (EskinError, ValueError) as error:
            logger.warning("%s", error)

    return obey_or_say
