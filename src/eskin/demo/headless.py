"""This module runs the demonstration without a browser, faster than real time."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, final

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
from eskin.sim.interactive import InteractiveSkin
from eskin.stream import CommandEvent, Context, Listener, Message, Recognition
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class DemoConfig:
    """Sets which skin, model and arm are demonstrated."""

    skin: str = "ur5"
    """Name of a preset skin."""
    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""
    commands: Path | None = None
    """Path of a command map; the map that comes with eskin unless given."""
    build_kind: Literal["fresh", "shifted"] = "fresh"
    """Sensors as in training, or aged ones with wider distributions."""
    build_seconds: float = 120.0
    """Time after which another build of the skin is simulated [s]."""
    seed: int = 0
    """Seed of builds, people and their touches."""
    dynamics: bool = False
    """Whether the arm has masses and servos, and yields to touches; if not, its joints
    are exactly at the set-points."""
    user: SimulatedUserConfig = field(default_factory=SimulatedUserConfig)
    """How often people touch."""


@dataclass(frozen=True)
class DemoResult:
    """Holds the score of a demonstration and what the arm did."""

    score: CommandScore
    """Touches, and the commands that were executed."""
    seconds: float
    """Duration in simulated time [s]."""
    accidents: int
    """Number of accidental touches, which should cause no command."""
    unlocked: int
    """Number of protective stops caused by touches."""
    delivered: int
    """Number of parts that the arm has delivered."""
    step: tuple[float, float]
    """Time of a recognition step, p50 and p99 [ms]."""

    @property
    def delay(self) -> tuple[float, float] | None:
        """Time from the end of a touch to its command, p50 and p95 [s], or None."""
        delays = self.score.delays()
        if not delays:
            return None
        return float(np.median(delays)), float(np.percentile(delays, 95))


def build_arm(config: DemoConfig, clock: Clock) -> SimulatedArm:
    """Build the arm that is touched.

    Raises:
        ExtraError: the arm has dynamics, and MuJoCo is not installed.
    """
    return SimulatedArm(clock=clock, plant=DynamicPlant() if config.dynamics else None)


@final
class SynchronousStream:
    """Calls its listeners in the thread of the caller.

    What one of them publishes, the others receive at once, so that results do not
    depend on the speed of the computer.
    """

    def __init__(self, source: LiveSource, listeners: list[Listener]) -> None:
        """Start all listeners."""
        self.source = source
        self.listeners = listeners
        for listener in listeners:
            listener.start(Context(source.info, source.clock, self.publish))

    def publish(self, item: Message) -> None:
        """Pass a message to all listeners of its type."""
        for listener in self.listeners:
            if isinstance(item, listener.message_types):
                listener.on_message(item)

    def close(self) -> None:
        """Close all listeners."""
        for listener in self.listeners:
            listener.close()


@final
class ScoreListener(Listener):
    """Adds detections and command events to a score."""

    name = "judge"
    message_types = (Detection, CommandEvent)
    size = 1
    drop = "never"

    def __init__(self, score: CommandScore) -> None:
        """Store the score to add to."""
        self.score = score

    def start(self, context: Context) -> None:
        """Do nothing."""

    def on_message(self, item: Message) -> None:
        """Add a detection or a command event."""
        if isinstance(item, Detection):
            self.score.add_detection(item)
        elif isinstance(item, CommandEvent):
            self.score.add_command(item)

    def close(self) -> None:
        """Do nothing."""


def run_headless(seconds: float, config: DemoConfig | None = None) -> DemoResult:
    """Simulate people who touch a working arm, on several builds of its skin in turn.

    Args:
        seconds: duration in simulated time [s].
        config: skin, model and arm.
    """
    config = config or DemoConfig()
    parts: list[DemoResult] = []
    left = seconds
    while left > 0:
        part = min(left, config.build_seconds)
        parts.append(run_build(part, config, config.seed + len(parts)))
        left -= part
    return merge_results(parts)


def run_build(seconds: float, config: DemoConfig, seed: int) -> DemoResult:
    """Simulate people who touch a working arm, on one build of its skin."""
    clock = ManualClock(NS_PER_S)
    arm = build_arm(config, clock)
    skin = InteractiveSkin(config.skin, seed, config.build_kind)
    model = load_model(config.model)
    vocabulary = model.card.vocabulary
    commands = load_commands(config.commands, vocabulary, skin.mounted.skin)
    user = SimulatedUser(skin, arm, commands, seed, config.user)
    source = LiveSource(
        skin,
        arm,
        clock,
        before_scan=user.update,
        after_scan=lambda: arm.apply_wrenches(skin.wrenches),
    )
    recognition = Recognition(Recognizer(model, skin.mounted, skin.calibration))
    policy = Policy(arm, commands, vocabulary, PolicyConfig(check_period=None))
    listeners = [ScoreListener(user.score), recognition, policy]
    stream = SynchronousStream(source, listeners)
    end = clock.now() + round(seconds * NS_PER_S)
    while source.due <= end or user.is_touching(source.due):
        user.active = source.due <= end
        scan = source.read()
        assert scan is not None
        stream.publish(scan)
    state = arm.state()
    stream.close()
    step = recognition.step
    return DemoResult(
        score=user.score,
        seconds=seconds,
        accidents=user.accidents,
        unlocked=user.unlocked,
        delivered=state.delivered,
        step=(1e3 * step.quantile(0.5), 1e3 * step.quantile(0.99)),
    )


def merge_results(parts: list[DemoResult]) -> DemoResult:
    """Merge several results into one."""
    scores = [part.score for part in parts]
    score = CommandScore(
        attempts=[attempt for each in scores for attempt in each.attempts],
        false_alarms=[command for each in scores for command in each.false_alarms],
        commands=sum(each.commands for each in scores),
        holds=sum(each.holds for each in scores),
    )
    return DemoResult(
        score=score,
        seconds=sum(part.seconds for part in parts),
        accidents=sum(part.accidents for part in parts),
        unlocked=sum(part.unlocked for part in parts),
        delivered=sum(part.delivered for part in parts),
        step=(
            float(np.median([part.step[0] for part in parts])),
            max(part.step[1] for part in parts),
        ),
    )
