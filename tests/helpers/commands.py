"""Arms that record their orders, and a policy on one of them, with touches."""

from dataclasses import dataclass, field, replace

import numpy as np

from eskin.arms import FRAME_TASK, UrArm
from eskin.arms.ur import PERIOD as UR_PERIOD
from eskin.arms.ur import ControllerLink, UrStatus
from eskin.command import (
    ASK,
    SUSPEND,
    Arm,
    ArmState,
    CommandMap,
    Policy,
    PolicyConfig,
    Problem,
    Rule,
    load_commands,
)
from eskin.drivers import ManualClock, SourceInfo
from eskin.errors import ArmError
from eskin.live import Detection
from eskin.robot import load_robot
from eskin.skin import MountedSkin, load_skin
from eskin.stream import Context, RecognitionState
from eskin.touch import (
    NO_CONTACT,
    NO_TOUCHES,
    Calibration,
    Fault,
    Reading,
    TouchRecord,
    TouchState,
)

SECOND = 1_000_000_000
PERIOD = SECOND // 50
VOCABULARY = ("none", "double_pat", "grab", "poke", "stroke")
SKIN = load_skin("ur5")
PATCH = SKIN.patches[4]
OTHER_PATCH = SKIN.patches[1]
MOUNTED = MountedSkin(SKIN, load_robot("ur5"))
Q = np.zeros(6)
INFO = SourceInfo(
    uri="sim:test",
    mounted=MOUNTED,
    calibration=Calibration.uniform(SKIN.count, 4095, 100.0),
    rate=50.0,
)
DIRECTION = np.array([0.6, 0.0, 0.8])
"""Direction of strokes: a unit vector in the world."""


def find_block(patch, rows, columns):
    """Return taxels of a patch in some rows and columns, near its middle."""
    members = SKIN.find_taxels(patch.id)
    row = int(np.median(SKIN.rows[members]))
    column = int(np.median(SKIN.columns[members]))
    inside = (SKIN.rows[members] - row >= 0) & (SKIN.rows[members] - row < rows)
    beside = SKIN.columns[members] - column
    block = members[inside & (beside >= 0) & (beside < columns)]
    assert len(block) == rows * columns
    return block


PLACE = np.concatenate([np.arange(n) / n for n in np.bincount(SKIN.patch_index)])
"""Where a taxel comes in its patch, from 0 to 1."""

FINGERTIP = find_block(PATCH, 2, 2)
"""Taxels that a fingertip touches."""


HAND = find_block(PATCH, 9, 6)
"""Taxels that a hand grasps."""


def make_map(**actions):
    """Return a command map of one rule a gesture."""
    rules = [Rule(gesture=gesture, action=done) for gesture, done in actions.items()]
    return CommandMap(commands=rules)


DEFAULT = make_map(
    poke="pause", grab="go_on", double_pat="toggle_gripper", stroke="slow"
)
TOGGLE = make_map(
    poke="pause",
    grab="toggle_pause",
    double_pat="toggle_gripper",
    stroke="toggle_speed",
)
"""Map in which one gesture stops and asks to go on."""
PAPER = load_commands("paper", VOCABULARY, SKIN, simulated=True)
"""Map of the paper, for simulated arms alone."""


def make_order(name, **changes):
    """Return a method of an arm that records an order and changes attributes."""

    def execute(arm):
        arm.record(name)
        for key, value in changes.items():
            setattr(arm, key, value)

    return execute


HELD = Problem.TOLD.reason(text="test")
"""Why a test holds an arm."""


class RecordingArm(Arm):
    """An arm that executes every order at once, and records it."""

    name = "ur5"
    joint_names = MOUNTED.robot.joint_names

    def __init__(self, clock):
        self.clock = clock
        self.orders = []
        self.steps = []
        self.paused = False
        self.hold_reason = None
        self.jogging = False
        self.speed = 1.0
        self.gripper = "open"
        self.at_work = True
        self.speed_limit = 1.0
        self.shows_question = False
        self.protective_stop = False
        self.connected = True
        self.error = None
        self.running = True

    def q_at(self, stamp):
        return Q

    def state(self):
        stopped = self.paused or self.hold_reason is not None or self.protective_stop
        return ArmState(
            stamp=self.clock.now(),
            q=Q,
            moving=self.at_work and not stopped and self.speed_limit > 0,
            paused=self.paused,
            hold_reason=self.hold_reason,
            speed=self.speed,
            gripper=self.gripper,
            target="rack",
            protective_stop=self.protective_stop,
            connected=self.connected,
            running=self.running,
            jogging=self.jogging,
            speed_limit=self.speed_limit,
            pause_count=self.orders.count("pause"),
        )

    def record(self, order):
        self.orders.append(order)
        if self.error is not None and order != "hold":
            raise self.error

    pause = make_order("pause", paused=True, jogging=False)
    resume = make_order("resume", paused=False)
    next_waypoint = make_order("next_waypoint")
    previous_waypoint = make_order("previous_waypoint")
    open_gripper = make_order("open_gripper", gripper="open")
    close_gripper = make_order("close_gripper", gripper="closed")

    def hold(self, reason):
        self.record("hold")
        self.hold_reason = self.hold_reason or reason

    def release(self):
        if self.protective_stop or not self.connected:
            raise ArmError("the arm stays held; allowed is later; wait")
        self.record("release")
        self.hold_reason = None

    def jog(self, step_world):
        self.record("jog")
        self.steps.append(step_world)
        self.jogging = True

    def set_speed(self, share):
        self.record("set_speed")
        self.speed = share

    def limit_speed(self, share):
        self.speed_limit = share

    def show_question(self, shown):
        self.shows_question = shown

    def close(self):
        self.hold(Problem.CLOSED.reason())


def is_held_for(arm, cause):
    """Return whether an arm is held for a cause."""
    reason = arm.state().hold_reason
    return reason is not None and reason.cause is cause


@dataclass
class SceneTouch:
    """A touch of a scene, which a test may change while it goes on."""

    onset: int
    last: int
    gesture: str
    confidence: float
    force: float
    pressed: bool = True
    taxels: np.ndarray = field(default_factory=lambda: FINGERTIP)
    pressure: float = 20.0
    direction: np.ndarray = field(default_factory=lambda: np.zeros(3))

    def probabilities(self):
        rest = (1 - self.confidence) / (len(VOCABULARY) - 1)
        probabilities = np.full(len(VOCABULARY), rest)
        probabilities[VOCABULARY.index(self.gesture)] = self.confidence
        return probabilities


class Scene:
    """A policy on a manual clock, an arm, and touches on its skin.

    Attributes:
        events: what the policy has published, but for touches that it waits for and
            questions.
        questions: events of questions.
        onsets: gesture and onset of each touch that has begun.
        waits: ids of the touches that the arm has stood for.
        touches: open touches by their id.
        held: records of touches that have closed, and still press.
        faulty_patches: ids of patches that are reported as faulty.
        silent_patches: ids of patches without valid taxels.
        doubtful: which taxels show signs of a fault.
        valid_share: share of the taxels of each patch that are valid.
        contact: pressure from which contact begins [kPa].
    """

    def __init__(self, commands=DEFAULT, **config):
        self.clock = ManualClock()
        self.arm = RecordingArm(self.clock)
        self.events = []
        self.waits = []
        self.questions = []
        self.onsets = []
        config = PolicyConfig(check_period=None, **config)
        self.policy = Policy(self.arm, commands, VOCABULARY, config)
        self.policy.start(Context(INFO, self.clock, self.note))
        self.touches = {}
        self.held = ()
        self.count = 0
        self.faulty_patches = self.silent_patches = ()
        self.doubtful = np.zeros(SKIN.count, bool)
        self.hidden = np.zeros(SKIN.count, np.float32)  # [kPa] of no contact
        self.valid_share = 1.0
        self.contact = 0.7

    def note(self, event):
        """Keep an event of the policy."""
        if event.action == SUSPEND:
            self.waits.append(event.touch)
        elif event.action == ASK:
            self.questions.append(event)
        else:
            self.events.append(event)

    @property
    def accepted(self):
        """Actions that were executed, holds by the policy among them."""
        return [event.action for event in self.events if event.accepted]

    @property
    def last_reason(self):
        """Reason of the last decision."""
        return self.events[-1].why

    def step(self, closed=()):
        """Give the next reading of the skin."""
        self.clock.sleep(PERIOD / SECOND)
        now = self.clock.now()
        pressure = self.hidden.copy()
        for touch in self.touches.values():
            touch.last = now if touch.pressed else touch.last
            if touch.pressed:
                pressure[touch.taxels] = touch.pressure
        going = tuple(self.status(number) for number in self.touches)
        faults = tuple(
            Fault("patch", patch, None, None, None, now)
            for patch in self.faulty_patches
        )
        silent = [patch.id in self.silent_patches for patch in SKIN.patches]
        valid = ~np.array(silent)[SKIN.patch_index] & (PLACE < self.valid_share)
        reading = Reading(now, pressure, valid, Q)
        tracking = NO_TOUCHES._replace(open=going, closed=closed, held=self.held)
        state = TouchState(
            reading, faults, self.doubtful, tracking, MOUNTED, contact=self.contact
        )
        probabilities = {n: touch.probabilities() for n, touch in self.touches.items()}
        self.policy.on_message(RecognitionState(state, probabilities, ()))

    def status(self, number, heir=0, closed=False):
        """Return the record of a touch; `heir` is the touch that it merged into."""
        touch = self.touches[number]
        return TouchRecord(
            number,
            touch.onset,
            touch.last,
            heir,
            closed,
            contact=NO_CONTACT._replace(patch=SKIN.patch_index[touch.taxels[0]]),
            force=touch.force,
            taxels=np.array(touch.taxels),
        )

    def wait(self, seconds):
        """Give readings for a time [s]."""
        for _ in range(round(seconds * SECOND / PERIOD)):
            self.step()

    def begin(self, gesture="poke", confidence=0.99, force=5.0):
        """Begin a touch and return its id."""
        self.count += 1
        onset = self.clock.now() + PERIOD
        self.onsets.append((gesture, onset))
        touch = SceneTouch(onset, onset, gesture, confidence, force)
        touch.direction = DIRECTION if gesture == "stroke" else touch.direction
        touch.taxels = HAND if gesture == "grab" else touch.taxels
        self.touches[self.count] = touch
        return self.count

    def begin_detected(
        self, gesture="poke", confidence=0.99, seconds=0.2, force=5.0, **detection
    ):
        """Begin a touch that is detected after a time [s], and return its id."""
        number = self.begin(gesture, confidence, force)
        self.wait(seconds)
        self.detect(number, **detection)
        return number

    def lift(self, number):
        """Lift the finger; the touch closes later."""
        self.touches[number].pressed = False

    def close(self, number, heir=0, is_held=False):
        """Close a touch, or merge it into its heir; something may press on."""
        status = self.status(number, heir, True)
        if is_held:
            status.held = status.taxels
            self.held = (*self.held, status)
        del self.touches[number]
        self.step((status,))

    def detect(
        self, number, age=0.0, patch=PATCH, gesture=None, confidence=None, likeliest=""
    ):
        """Detect a touch and return the decisions that follow at once."""
        touch = self.touches[number]
        before = len(self.events)
        self.policy.on_message(
            Detection(
                stamp=self.clock.now() - round(age * SECOND),
                touch=number,
                gesture=gesture or touch.gesture,
                confidence=touch.confidence if confidence is None else confidence,
                onset=touch.onset,
                end=touch.last,
                link=patch.link,
                patch=patch.id,
                p_world=np.zeros(3),
                n_world=np.zeros(3),
                direction_world=touch.direction,
                peak_force=touch.force,
                likeliest=likeliest,
            )
        )
        return self.events[before:]

    def touch(self, gesture="poke", confidence=0.99):
        """Touch from beginning to closing and return the decisions on the way."""
        before = len(self.events)
        number = self.begin_detected(gesture, confidence, 0.3)
        self.wait(0.1)
        self.lift(number)
        self.wait(0.5)
        self.close(number)
        return self.events[before:]

    def ask(self, gesture="grab", delay=0.5, answer="poke"):
        """Touch and answer the question; return the decisions on the way."""
        before = len(self.events)
        self.touch(gesture)
        self.wait(delay)
        self.touch(answer)
        self.wait(0.3)
        return self.events[before:]


def make_paused_scene(commands=DEFAULT, **config):
    """Build a scene whose arm a poke has paused more than a second ago."""
    scene = Scene(commands, **config)
    scene.touch()
    scene.wait(1.0)
    assert scene.arm.paused
    return scene


WELL = UrStatus(
    q=tuple(np.array(FRAME_TASK.waypoints[0].q) + (1.5, 0, 0, 0, 0, 0)),
    running=True,
    protective_stop=False,
    emergency_stop=False,
    scaling=1.0,
    gripper_closed=False,
)
"""Status of a UR that works, some way from its first waypoint."""


class StubLink(ControllerLink):
    """A link to a robot that is at once where it is sent, and records its commands."""

    def __init__(self, status=WELL, problem=None, follows=True):
        self.status = status
        self.problem = problem
        self.follows = follows
        self.commands = []
        self.closed = False

    def exchange(self, command):
        self.commands.append(command)
        if self.status is None:
            return None
        if command.q is not None and self.status.running and self.follows:
            self.status = replace(self.status, q=command.q)
        if command.gripper_closed is not None:
            self.status = replace(self.status, gripper_closed=command.gripper_closed)
        return self.status

    def close(self):
        self.closed = True


def make_ur_arm(release=True, **link):
    """Return a UR arm without a thread, released a second ago, and its link."""
    link = StubLink(**link)
    arm = UrArm(link, clock=ManualClock(), threaded=False)
    pass_ur_time(arm, 0.1)
    if release:
        arm.release()
        pass_ur_time(arm, 1.0)
    return arm, link


def pass_ur_time(arm, seconds):
    """Update a UR arm for a time [s] and return its positions."""
    positions = []
    for _ in range(round(seconds / UR_PERIOD)):
        arm.clock.sleep(UR_PERIOD)
        arm.update()
        positions.append(np.array(arm.status.q))
    return np.array(positions)
