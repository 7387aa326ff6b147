"""This module plays the packets of patches to a policy on a simulated clock.

Every count tells when its scan was made, so the true age of all data is known. Nothing
in here takes real time: the recogniser is left out, and a reading is at once with the
policy.
"""

import heapq
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, final

import numpy as np
from jaxtyping import Float

from eskin.command import Arm, ArmState, CommandMap, Policy, PolicyConfig, Rule
from eskin.drivers import (
    Assembler,
    Clock,
    Data,
    Event,
    EventLog,
    FixedJoints,
    Hello,
    ManualClock,
    SourceInfo,
)
from eskin.reasons import Reason
from eskin.robot import load_robot
from eskin.skin import MountedSkin, Patch, Plane, Skin, TaxelGrid, build_skin
from eskin.stream import Context, Message, RecognitionState
from eskin.touch import (
    NO_TOUCHES,
    Calibration,
    Reading,
    Scan,
    TouchState,
)
from eskin.units import NS_PER_S

START = 10**18
"""When playing begins [ns since the epoch]."""
ROWS = 4
COLUMNS = 4
CHECK = NS_PER_S // 50
"""Interval at which the policy checks the skin without a reading [ns]."""
UPTIME = 7.0
"""Time since the power-up of a patch when playing begins [s]."""
Q = np.zeros(0)


def build_flat_skin(patches: int) -> Skin:
    """Build a skin of equal patches on a table."""
    laid = []
    for number in range(patches):
        place = np.eye(4)
        place[0, 3] = 0.1 * number
        patch = Patch(f"patch_{number}", "table", number, ROWS, COLUMNS)
        laid.append((patch, TaxelGrid(ROWS, COLUMNS, 0.01, 0.01), Plane(place)))
    return build_skin("flat", laid)


class PlayedEcho(NamedTuple):
    """An echo carries the clock of a patch to the host."""

    address: int
    """Address of the patch."""
    device_time: int
    """Clock of the patch [us], modulo 2**32."""
    sent: int
    """When the host sent its request [ns]."""


class Arrival(NamedTuple):
    """An arrival is what comes to the host at some time."""

    arrived: int
    """When it comes [ns]."""
    made: int
    """When it was made [ns]."""
    packet: Data | Hello | PlayedEcho
    """What comes."""


@dataclass(frozen=True)
class PlayedPatch:
    """A patch whose counts tell when its scans were made."""

    address: int
    """Address of the patch."""
    rate: float = 50.0
    """Scans a second."""
    error: float = 0.0
    """Relative error of its clock; positive is too fast."""
    phase: float = 0.0
    """When in a period it scans, from 0 to 1."""

    def read_clock(self, now: int) -> int:
        """Return its clock [us], modulo 2**32."""
        elapsed = (now - START + round(UPTIME * NS_PER_S)) * (1 + self.error)
        return round(elapsed / 1000) % 2**32

    def send(self, seconds: float, echo_interval: float | None) -> Iterator[Arrival]:
        """Yield what it sends, as it is made, with the echoes of the host's requests.

        Args:
            seconds: time for which it sends [s].
            echo_interval: time between two requests of the host [s]; None sends none.
        """
        echo_at = 0.0
        for number in range(round(seconds * self.rate)):
            made = START + round((number + self.phase) * NS_PER_S / self.rate)
            scan = number % 2**16
            time = self.read_clock(made)
            if number % round(self.rate) == 0:
                hello = (ROWS, COLUMNS, ROWS * COLUMNS, round(self.rate))
                serial = 1000 + self.address
                packet = Hello(self.address, scan, time, *hello, serial, "played")
                yield Arrival(made, made, packet)
            if echo_interval is not None and (made - START) / NS_PER_S >= echo_at:
                echo_at += echo_interval
                yield Arrival(made, made, PlayedEcho(self.address, time, made))
            counts = np.resize((number & 0xFFFF, number >> 16), ROWS * COLUMNS)
            data = Data(self.address, scan, time, 0, counts.astype(np.uint16))
            yield Arrival(made, made, data)

    def find_made(self, scan: Scan) -> int | None:
        """Return when the data of this patch in a scan was made; None without data."""
        part = slice(self.address * ROWS * COLUMNS, (self.address + 1) * ROWS * COLUMNS)
        if not scan.received[part].all():
            return None
        low, high = scan.counts[part][:2]
        number = int(low) + (int(high) << 16)
        return START + round((number + self.phase) * NS_PER_S / self.rate)


@final
class HeldArm(Arm):
    """An arm that does nothing but to note when it is held.

    Attributes:
        held_at: when it was held [ns]; None while it is not.
        limited_at: when it was slowed first [ns]; None while it was not.
    """

    name = "table"
    joint_names = ()

    def __init__(self, clock: Clock) -> None:
        """Start to move."""
        self.clock = clock
        self.held_at: int | None = None
        self.limited_at: int | None = None
        self.reason: Reason | None = None

    def q_at(self, stamp: int) -> Float[np.ndarray, "joint"]:
        """Return no joint positions."""
        return Q

    def state(self) -> ArmState:
        """Return a state that moves, unless it is held."""
        return ArmState(
            stamp=self.clock.now(),
            q=Q,
            moving=self.reason is None,
            paused=False,
            hold_reason=self.reason,
            speed=1.0,
            gripper="open",
            target="",
            protective_stop=False,
            connected=True,
        )

    def hold(self, reason: Reason) -> None:
        """Note when it is held first."""
        if self.reason is None:
            self.held_at = self.clock.now()
            self.reason = reason

    def release(self) -> None:
        """Move again."""
        self.held_at = self.limited_at = self.reason = None

    def ignore(self) -> None:
        """Do nothing."""

    pause = resume = next_waypoint = previous_waypoint = ignore
    open_gripper = close_gripper = close = ignore

    def set_speed(self, share: float) -> None:
        """Do nothing."""

    def limit_speed(self, share: float) -> None:
        """Note when it is slowed first."""
        if share < 1 and self.limited_at is None:
            self.limited_at = self.clock.now()

    def jog(self, step_world: Float[np.ndarray, "3"]) -> None:
        """Do nothing."""


@final
class PlayedLine:
    """Plays arrivals to an assembler and a policy, and notes what the policy believes.

    Attributes:
        obeyed: largest true age of data on which a touch was obeyed [ns].
        events: events of the line.
        arm: the arm that is held.
    """

    def __init__(self, patches: Iterable[PlayedPatch], rate: float = 50.0) -> None:
        """Start an assembler and a policy; the first patch is the target."""
        self.patches = tuple(patches)
        self.target = self.patches[0]
        skin = build_flat_skin(len(self.patches))
        self.mounted = MountedSkin(skin, load_robot("table"))
        self.clock = ManualClock(START)
        self.log = EventLog()
        self.assembler = Assembler(skin, FixedJoints(Q), self.log)
        self.assembler.start(START, rate)
        calibration = Calibration.uniform(skin.count, 4095, 100.0)
        info = SourceInfo("played:", self.mounted, calibration, rate)
        self.arm = HeldArm(self.clock)
        self.policy = Policy(
            self.arm,
            CommandMap(commands=[Rule(gesture="poke", action="pause")]),
            ("none", "poke"),
            PolicyConfig(check_period=None),
        )
        self.policy.start(Context(info, self.clock, self.ignore))
        self.check_at = START
        self.obeyed = 0
        self.made: list[int] = []
        self.events: list[Event] = []

    def ignore(self, message: Message) -> None:
        """Let go what the policy publishes."""

    def play(self, arrivals: Iterable[Arrival], until: float) -> None:
        """Play arrivals, which are in order, then wait until a time [s]."""
        end = START + round(until * NS_PER_S)
        for arrival in arrivals:
            if arrival.arrived > end:
                break
            self.wait(arrival.arrived)
            self.receive(arrival)
        self.wait(end)

    def receive(self, arrival: Arrival) -> None:
        """Pass an arrival on, and whatever is ready then."""
        arrived, _, packet = arrival
        if isinstance(packet, PlayedEcho):
            clock = self.assembler.streams[packet.address].clock
            clock.push_echo(packet.device_time, packet.sent, arrived)
        else:
            self.assembler.push_packet(packet, arrived, "line")
        self.poll(arrived)

    def wait(self, until: int) -> None:
        """Let time pass, with the checks and deadlines on the way."""
        while True:
            deadline = self.assembler.next_deadline()
            next_time = min(self.check_at, deadline or until)
            if next_time > until:
                break
            self.poll(next_time)
            if next_time == self.check_at:
                self.policy.check_skin()
                self.check_at += CHECK

    def poll(self, now: int) -> None:
        """Pass the scans that are ready to the policy."""
        now = max(now, self.clock.time)
        self.clock.time = now
        for scan in self.assembler.poll(now):
            self.take(scan)
        self.events += self.log.take()

    def take(self, scan: Scan) -> None:
        """Let the policy judge a touch in every scan with data of the target."""
        pressure = np.zeros(len(scan.counts), np.float32)
        reading = Reading(scan.stamp, pressure, scan.received, Q)
        tracking = NO_TOUCHES
        doubtful = np.zeros(len(scan.counts), bool)
        state = TouchState(reading, (), doubtful, tracking, self.mounted)
        self.policy.on_message(RecognitionState(state, {}, ()))
        made = self.target.find_made(scan)
        if made is None:
            return
        self.made.append(made)
        now = self.clock.now()
        is_felt = now - scan.stamp <= self.policy.config.monitor.max_age * NS_PER_S
        if is_felt and self.arm.state().problem is None:
            self.obeyed = max(self.obeyed, now - made)


def merge_arrivals(*streams: Iterable[Arrival]) -> Iterator[Arrival]:
    """Merge streams of arrivals, each of them in order."""
    return heapq.merge(*streams, key=lambda arrival: arrival.arrived)
