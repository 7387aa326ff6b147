"""An arm in its simulated skin, commanded by touch, one scan after the other."""

from collections.abc import Callable
from dataclasses import replace
from typing import final, get_args

from eskin.arms import SimulatedArm
from eskin.command import Policy, PolicyConfig, SkinMonitorConfig, load_commands
from eskin.drivers import ManualClock
from eskin.live import Detection, Recognizer, load_model
from eskin.recording import TruthRecord
from eskin.sim.demo import LiveSource, TouchCauses
from eskin.sim.demo.headless import SynchronousStream
from eskin.sim.interactive import InteractiveSkin
from eskin.sim.sensor import FAMILIES
from eskin.sim.sensor.build import BuildKind
from eskin.stream import (
    CommandEvent,
    Context,
    Listener,
    Message,
    Recognition,
    RecognitionState,
)
from eskin.touch import TouchState
from eskin.units import NS_PER_S

KINDS: tuple[BuildKind, ...] = ("fresh", *FAMILIES)
"""Kinds of builds that an arm is touched on."""

APART = 100
"""Difference of the first seeds of two kinds."""

TARE = 3.0
"""Time without touch at the start [s]."""


@final
class ArmNotes(Listener):
    """Notes what the skin felt of each simulated touch, and what the policy decided.

    Attributes:
        felt: when each simulated touch was first felt, by its number [ns].
        pressing: numbers of the simulated touches that are felt in the latest reading.
        detections: what was detected, oldest first.
        decisions: what was decided, oldest first.
        causes: simulated touch of each tracked one.
    """

    name = "notes"
    message_types = (RecognitionState, Detection, CommandEvent)
    size = 1
    drop = "never"

    def __init__(self, truths: Callable[[], tuple[TruthRecord, ...]]) -> None:
        """Start without notes; `truths` returns the touches of the latest scan."""
        self.truths = truths
        self.felt: dict[int, int] = {}
        self.pressing: set[int] = set()
        self.detections: list[Detection] = []
        self.decisions: list[CommandEvent] = []
        self.causes = TouchCauses()

    def start(self, context: Context) -> None:
        """Do nothing."""

    def on_message(self, item: Message) -> None:
        """Note a recognition state, a detection or a decision."""
        if isinstance(item, Detection):
            self.detections.append(item)
        elif isinstance(item, CommandEvent):
            self.decisions.append(item)
        elif isinstance(item, RecognitionState):
            self.note_contacts(item.state)

    def note_contacts(self, state: TouchState) -> None:
        """Note which simulated touches are felt in a reading."""
        stamp = state.reading.stamp
        self.causes.update(state, self.truths())
        self.pressing = set()
        for row in state.open:
            number = self.causes.find(row.id)
            if number is not None and row.last == stamp:
                self.felt.setdefault(number, stamp)
                self.pressing.add(number)

    def list_detections(self, number: int) -> list[Detection]:
        """Return what a simulated touch was detected as, oldest first."""
        return [one for one in self.detections if self.causes.find(one.touch) == number]

    def close(self) -> None:
        """Do nothing."""


@final
class TouchedArm:
    """An arm at its task in a simulated skin, with the policy.

    Attributes:
        arm: the arm.
        skin: its skin, whose hand touches it.
        policy: the policy that commands it.
        notes: what was felt, detected and decided.
        stamp: stamp of the latest scan [ns since the epoch].
    """

    def __init__(
        self, kind: BuildKind, seed: int, config: PolicyConfig | None = None
    ) -> None:
        """Start the arm, and wait until the skin is tared.

        Args:
            kind: kind of the build of the skin.
            seed: its seed.
            config: how careful the policy is; as ever unless given.

        Raises:
            ArmError: the skin is too slow to command it.
        """
        clock = ManualClock(NS_PER_S)
        self.arm = SimulatedArm(clock=clock)
        self.skin = InteractiveSkin("ur5", seed, kind)
        model = load_model("ur5")
        mounted = self.skin.mounted
        vocabulary = model.card.vocabulary
        commands = load_commands(None, vocabulary, mounted.skin)
        config = replace(config or PolicyConfig(), check_period=None)
        self.policy = Policy(self.arm, commands, vocabulary, config)
        self.notes = ArmNotes(self.skin.hand.truths)
        self.source = LiveSource(self.skin, self.arm, clock)
        recognizer = Recognizer(model, mounted, self.skin.calibration)
        listeners = [self.notes, Recognition(recognizer), self.policy]
        self.stream = SynchronousStream(self.source, listeners)
        self.stamp = clock.now()
        self.wait(TARE)

    def read(self) -> int:
        """Read the next scan, and return its stamp [ns since the epoch]."""
        scan = self.source.read()
        assert scan is not None
        self.stream.publish(scan)
        self.stamp = scan.stamp
        return self.stamp

    def wait(self, seconds: float) -> None:
        """Read scans for a time [s]."""
        self.wait_until(lambda: False, seconds)

    def wait_until(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Read scans until a condition holds; return whether it does.

        Args:
            condition: is looked at before each scan.
            seconds: longest time [s].
        """
        end = self.stamp + round(seconds * NS_PER_S)
        while not condition():
            if self.stamp >= end:
                return False
            self.read()
        return True

    def is_suspended(self) -> bool:
        """Return whether the arm is stopped, or must not move for now."""
        state = self.arm.state()
        return state.stopped or state.speed_limit == 0.0

    def go(self) -> None:
        """Let a stopped arm go on, as a program does."""
        self.arm.release()
        self.arm.resume()

    def find_truth(self, number: int) -> TruthRecord | None:
        """Return what a touch truly does in the latest scan; None without contact."""
        truths = self.skin.hand.truths()
        return next((one for one in truths if one.touch == number), None)

    def close(self) -> None:
        """Close the policy."""
        self.stream.close()


def list_seeds(kind: BuildKind, first: int, count: int) -> list[int]:
    """Return the seeds of the first builds of a kind that may command an arm.

    Those of each kind begin `APART` after the kind before, so that people differ too.

    Args:
        kind: kind of the builds.
        first: the seed at which those of the first kind begin.
        count: number of builds.
    """
    first += APART * get_args(BuildKind).index(kind)
    least = 2 / SkinMonitorConfig().max_age
    seeds: list[int] = []
    while len(seeds) < count:
        if InteractiveSkin("ur5", first, kind).period <= 1 / least:
            seeds.append(first)
        first += 1
    return seeds
