"""The demonstration without a browser: scripted touches, on a clock of its own."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from eskin.command import (
    DynamicPlant,
    Policy,
    PolicyConfig,
    SimulatedArm,
    load_commands,
)
from eskin.demo.live_source import LiveSource
from eskin.demo.simulated_user import CommandScore, SimulatedUser, SimulatedUserConfig
from eskin.drivers import Clock, ManualClock
from eskin.live import Detection, Recognizer
from eskin.model import load_model
from eskin.sim.interactive.skin import LiveSkin
from eskin.stream import CommandEvent, Context, Listener, Message, Recognition
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class DemoConfig:
    """What is demonstrated."""

    skin: str = "ur5"
    """A preset skin."""

    model: str = "ur5"
    """Weights that come with eskin, or a model file."""

    commands: Path | None = None
    """Which touch commands what; the map that comes with eskin unless given."""

    build_kind: Literal["fresh", "shifted"] = "fresh"
    """Sensors as in training, or aged ones of wider laws."""

    build_seconds: float = 120.0
    """After how long another build of the skin is put on [s]."""

    seed: int = 0
    """Decides builds, people and what they do."""

    dynamics: bool = False
    """Whether the arm has masses and servos, and yields to who touches it; else it is
    exactly where it is to be."""

    visitor: SimulatedUserConfig = field(default_factory=SimulatedUserConfig)
    """How often people touch."""


@dataclass(frozen=True)
class DemoResult:
    """What came of it."""

    score: CommandScore
    """Touches, and what was obeyed."""

    seconds: float
    """How long it lasted in simulated time [s]."""

    accidents: int
    """Touches that asked for nothing."""

    unlocked: int
    """How often a push had put the arm into protective stop."""

    delivered: int
    """Parts that the arm has brought."""

    step: tuple[float, float]
    """Time of a step, p50 and p99 [ms]."""

    @property
    def delay(self) -> tuple[float, float] | None:
        """From the end of a touch to its command, p50 and p95 [s]; None of none."""
        delays = self.score.delays()
        if not delays:
            return None
        return float(np.median(delays)), float(np.percentile(delays, 95))


def arm_of(config: DemoConfig, clock: Clock) -> SimulatedArm:
    """The arm that is touched.

    Raises:
        ExtraError: it has dynamics, and MuJoCo is not installed.
    """
    return SimulatedArm(clock=clock, plant=DynamicPlant() if config.dynamics else None)


class SynchronousStream:
    """Tells listeners one after the other in the caller's own thread; final.

    What one of them tells, the others hear at once, so that nothing depends on how fast
    the computer is.
    """

    def __init__(self, source: LiveSource, listeners: list[Listener]) -> None:
        """Start all of them."""
        self.source = source
        self.listeners = listeners
        for listener in listeners:
            listener.start(Context(source.info, source.clock, self.tell))

    def tell(self, item: Message) -> None:
        """Give something to all who hear its kind."""
        for listener in self.listeners:
            if isinstance(item, listener.message_types):
                listener.on_message(item)

    def close(self) -> None:
        """Close all of them."""
        for listener in self.listeners:
            listener.close()


class ScoreListener(Listener):
    """Hears what is recognised and decided for a score; final."""

    name = "judge"
    message_types = (Detection, CommandEvent)
    size = 1
    drop = "never"

    def __init__(self, score: CommandScore) -> None:
        """ScoreListener into a score."""
        self.score = score

    def start(self, context: Context) -> None:
        """Nothing needs to be made ready."""

    def on_message(self, item: Message) -> None:
        """Take in what is recognised or decided."""
        if isinstance(item, Detection):
            self.score.note(item)
        elif isinstance(item, CommandEvent):
            self.score.on_message(item)

    def close(self) -> None:
        """Nothing is held."""


def run_headless(seconds: float, config: DemoConfig | None = None) -> DemoResult:
    """Let people touch an arm at work, on one build of its skin after the other.

    Args:
        seconds: how long, in simulated time [s].
        config: what is demonstrated.
    """
    config = config or DemoConfig()
    parts = []
    left, number = seconds, 0
    while left > 0:
        part = min(left, config.build_seconds)
        parts.append(run_build(part, config, config.seed + number))
        left -= part
        number += 1
    return joined(parts)


def run_build(seconds: float, config: DemoConfig, seed: int) -> DemoResult:
    """The same on one build."""
    clock = ManualClock(NS_PER_S)
    arm = arm_of(config, clock)
    skin = LiveSkin(config.skin, seed, config.build_kind)
    model = load_model(config.model)
    vocabulary = model.card.vocabulary
    commands = load_commands(config.commands, vocabulary, skin.mounted.skin)
    visitor = SimulatedUser(skin, arm, commands, seed, config.visitor)
    source = LiveSource(
        *(skin, arm, clock),
        before=visitor.come,
        after=lambda: arm.apply_wrenches(skin.wrenches),
    )
    recognition = Recognition(Recognizer(model, skin.mounted, skin.calibration))
    policy = Policy(arm, commands, vocabulary, PolicyConfig(check_period=None))
    listeners = [ScoreListener(visitor.score), recognition, policy]
    straight = SynchronousStream(source, listeners)
    end = clock.now() + round(seconds * NS_PER_S)
    while source.due <= end or visitor.is_touching(source.due):
        visitor.stays = source.due <= end
        scan = source.read()
        assert scan is not None
        straight.tell(scan)
    state = arm.state()
    straight.close()
    step = recognition.step
    return DemoResult(
        visitor.score,
        seconds,
        visitor.accidents,
        visitor.unlocked,
        state.delivered,
        (1e3 * step.quantile(0.5), 1e3 * step.quantile(0.99)),
    )


def joined(parts: list[DemoResult]) -> DemoResult:
    """Several outcomes as one."""
    scores = [part.score for part in parts]
    score = CommandScore(
        [attempt for each in scores for attempt in each.tries],
        [command for each in scores for command in each.false_alarms],
        sum(each.commands for each in scores),
        sum(each.holds for each in scores),
    )
    return DemoResult(
        score,
        sum(part.seconds for part in parts),
        sum(part.accidents for part in parts),
        sum(part.unlocked for part in parts),
        sum(part.delivered for part in parts),
        (
            float(np.median([part.step[0] for part in parts])),
            max(part.step[1] for part in parts),
        ),
    )
