"""This module runs the demonstration without a browser, faster than real time."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import final

import numpy as np

from eskin.arms import FRAME_TASK, DynamicPlant, MotionConfig, SimulatedArm
from eskin.command import Policy, PolicyConfig, load_commands
from eskin.drivers import Clock, ManualClock
from eskin.errors import DeviceError
from eskin.live import Recognizer, load_model
from eskin.sim.demo.live_source import FaultStorm, LiveSource, StormConfig
from eskin.sim.demo.score import CommandScore, ScoreListener
from eskin.sim.demo.simulated_user import SimulatedUser, SimulatedUserConfig
from eskin.sim.interactive import InteractiveSkin
from eskin.sim.sensor.build import BuildKind
from eskin.skin import KeptRobot
from eskin.stream import Context, Listener, Message, Recognition
from eskin.units import NS_PER_S


@dataclass(frozen=True)
class DemoConfig:
    """Sets which skin, model and arm are demonstrated."""

    skin: str = "ur5"
    """Name of a preset skin, or folder of a skin."""
    robot: str | None = None
    """Robot that wears the skin: its name, or the path of its URDF; None for the skin's
    own. A robot other than the UR5 stands still, and is not commanded."""
    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""
    commands: Path | None = None
    """Path of a command map, or `paper`; the default map unless given."""
    build_kind: BuildKind = "fresh"
    """Sensors as in training, `shifted` ones of wider distributions, or those of a
    family."""
    build_seconds: float = 120.0
    """Time after which another build of the skin is simulated [s]."""
    seed: int = 0
    """Seed of builds, people and their touches."""
    dynamics: bool = False
    """Whether the arm has masses and servos, and yields to touches; if not, its joints
    are exactly at the set-points."""
    arm_speed: float = 1.0
    """Full speed of the arm as a share of the usual one, above 0."""
    user: SimulatedUserConfig = field(default_factory=SimulatedUserConfig)
    """How often people touch."""
    storm: StormConfig = field(default_factory=StormConfig)
    """Faults of the skin beside the faults of its build."""


@dataclass(frozen=True)
class DemoResult:
    """Holds the score of a demonstration and what the arm did."""

    score: CommandScore
    """Touches, and the commands that were executed."""
    seconds: float
    """Duration in simulated time [s]."""
    suspended_seconds: float
    """Time for which the arm was held though no person had asked for it [s]."""
    unlocked: int
    """Number of protective stops caused by touches."""
    delivered: int
    """Number of parts that the arm has delivered."""
    step: tuple[float, float]
    """Time of a recognition step, p50 and p99 [ms]."""

    @property
    def delay(self) -> tuple[float, float] | None:
        """Time from the end of a touch to its command, p50 and p95 [s], or None."""
        return compute_quantiles(self.score.delays())

    @property
    def stop_delay(self) -> tuple[float, float] | None:
        """Time from the onset of a touch to its stop, p50 and p95 [s], or None."""
        return compute_quantiles(self.score.stop_delays())

    @property
    def availability(self) -> float:
        """Share of the time in which the arm is not suspended, 0 to 1."""
        return 1.0 - self.suspended_seconds / self.seconds


def compute_quantiles(values: list[float]) -> tuple[float, float] | None:
    """Return the median and the 95th percentile, or None where there is no value."""
    if not values:
        return None
    return float(np.median(values)), float(np.percentile(values, 95))


def build_arm(config: DemoConfig, clock: Clock) -> SimulatedArm:
    """Build the arm that is touched.

    Raises:
        ExtraError: the arm has dynamics, and MuJoCo is not installed.
    """
    usual = MotionConfig()
    motion = MotionConfig(
        speed=usual.speed * config.arm_speed,
        acceleration=usual.acceleration * config.arm_speed,
    )
    plant = DynamicPlant() if config.dynamics else None
    return SimulatedArm(clock=clock, motion=motion, plant=plant)


def is_on_arm(skin: InteractiveSkin) -> bool:
    """Tell whether a skin is on the arm that is simulated at its task."""
    return skin.wearer == KeptRobot(FRAME_TASK.robot_name)


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


def run_headless(seconds: float, config: DemoConfig | None = None) -> DemoResult:
    """Simulate people who touch a working arm, on several builds of its skin in turn.

    `seconds` is simulated time [s].
    """
    config = config or DemoConfig()
    parts: list[DemoResult] = []
    left = seconds
    while left > 0:
        part = min(left, config.build_seconds)
        parts.append(run_build(part, config, config.seed + len(parts)))
        left -= part
    return merge_results(parts)


def run_build(
    seconds: float,
    config: DemoConfig,
    seed: int,
    watch: Callable[[CommandScore], list[Listener]] = lambda score: [],
) -> DemoResult:
    """Simulate people who touch a working arm, on one build of its skin.

    `seconds` is simulated time [s]; `watch` builds further listeners, given the score.
    """
    clock = ManualClock(NS_PER_S)
    arm = build_arm(config, clock)
    skin = InteractiveSkin(config.skin, seed, config.build_kind, robot=config.robot)
    if not is_on_arm(skin):
        raise DeviceError(
            f"robot '{skin.wearer.name}' is to be commanded without a page; allowed is "
            f"{FRAME_TASK.robot_name}, which works at a task; leave out --headless"
        )
    model = load_model(config.model)
    vocabulary = model.card.vocabulary
    commands = load_commands(
        config.commands,
        vocabulary,
        skin.mounted.skin,
        simulated=True,
    )
    policy = Policy(arm, commands, vocabulary, PolicyConfig(check_period=None))
    user = SimulatedUser(
        skin, arm, commands, seed, config.user, lambda: policy.question
    )
    storm = FaultStorm(skin, config.storm, seed)
    source = LiveSource(
        skin,
        arm,
        clock,
        before_scan=user.update,
        after_scan=lambda: arm.apply_wrenches(skin.wrenches),
    )
    recognition = Recognition(Recognizer(model, skin.mounted, skin.calibration))
    listeners = [ScoreListener(user.score, skin.hand.truths), recognition, policy]
    stream = SynchronousStream(source, [*listeners, *watch(user.score)])
    end = clock.now() + round(seconds * NS_PER_S)
    suspended = 0
    while source.due <= end or user.is_touching(source.due):
        user.active = source.due <= end
        storm.update(source.due)
        scan = source.read()
        assert scan is not None
        stream.publish(storm.corrupt(scan))
        suspended += user.active and arm.state().hold_reason is not None
    state = arm.state()
    stream.close()
    step = recognition.step
    return DemoResult(
        score=user.score,
        seconds=seconds,
        suspended_seconds=suspended * skin.period,
        unlocked=user.unlocked,
        delivered=state.delivered,
        step=(1e3 * step.quantile(0.5), 1e3 * step.quantile(0.99)),
    )


def merge_results(parts: list[DemoResult]) -> DemoResult:
    """Merge several results into one."""
    score = CommandScore()
    for each in (part.score for part in parts):
        for name in ("attempts", "accidents", "false_alarms", "by_faults"):
            getattr(score, name).extend(getattr(each, name))
        score.commands += each.commands
        score.holds += each.holds
        score.asked += each.asked
        score.answered += each.answered
    return DemoResult(
        score=score,
        seconds=sum(part.seconds for part in parts),
        suspended_seconds=sum(part.suspended_seconds for part in parts),
        unlocked=sum(part.unlocked for part in parts),
        delivered=sum(part.delivered for part in parts),
        step=(
            float(np.median([part.step[0] for part in parts])),
            max(part.step[1] for part in parts),
        ),
    )
