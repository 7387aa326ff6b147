"""An arm that does as it is told and remembers it, and touches for a policy."""

import numpy as np

from eskin.command import Arm, ArmState, CommandMap, Policy, PolicyConfig, Rule
from eskin.drivers import ManualClock, SourceInfo
from eskin.errors import ArmError
from eskin.live import Detection
from eskin.robot import load_robot
from eskin.skin import MountedSkin, load_skin
from eskin.stream import Context, RecognitionState
from eskin.structref_kernels import pack
from eskin.touch import (
    NO_TOUCHES,
    TOUCH,
    Calibration,
    Fault,
    Reading,
    TouchState,
    TouchStatus,
    TrackingResult,
)

SECOND = 1_000_000_000
PERIOD = SECOND // 50
VOCABULARY = ("none", "double_pat", "grab", "poke", "stroke")
SKIN = load_skin("ur5")
PATCH = SKIN.patches[4]
MOUNTED = MountedSkin(SKIN, load_robot("ur5"))
Q = np.zeros(6)
INFO = SourceInfo(
    uri="sim:test",
    robot_name="ur5",
    joint_names=MOUNTED.robot.joint_names,
    skin=SKIN,
    calibration=Calibration.uniform(SKIN.count, 4095, 100.0),
    rate=50.0,
)
WAY = np.array([0.6, 0.0, 0.8])
"""Where strokes go: a unit vector in the world."""
DEFAULT = CommandMap(
    commands=[
        Rule(gesture="poke", action="toggle_pause"),
        Rule(gesture="double_pat", action="next_waypoint"),
        Rule(gesture="grab", action="toggle_gripper"),
        Rule(gesture="stroke", action="toggle_speed"),
    ]
)


class ToldArm(Arm):
    """Does what it is told at once; what is wrong with it is set from outside."""

    name = "ur5"
    joint_names = MOUNTED.robot.joint_names

    def __init__(self, clock):
        self.clock = clock
        self.told = []
        self.paused, self.hold_reason, self.speed, self.gripper = (
            False,
            None,
            1.0,
            "open",
        )
        self.protective_stop, self.connected, self.broken = False, True, None
        self.working = True
        self.jogging, self.steps = False, []

    def q_at(self, stamp):
        return Q

    def state(self):
        stopped = self.paused or self.hold_reason is not None or self.protective_stop
        return ArmState(
            self.clock.now(),
            Q,
            self.working and not stopped,
            self.paused,
            self.hold_reason,
            self.speed,
            self.gripper,
            "rack",
            self.protective_stop,
            self.connected,
            jogging=self.jogging,
            pause_count=self.told.count("pause"),
        )

    def tell(self, what):
        self.told.append(what)
        if self.broken is not None and what != "hold":
            raise self.broken

    def pause(self):
        self.tell("pause")
        self.paused, self.jogging = True, False

    def resume(self):
        self.tell("resume")
        self.paused = False

    def hold(self, why):
        self.tell("hold")
        self.hold_reason = self.hold_reason or why

    def release(self):
        if self.protective_stop or not self.connected:
            raise ArmError("the arm stays held; allowed is later; wait")
        self.tell("release")
        self.hold_reason = None

    def next_waypoint(self):
        self.tell("next_waypoint")

    def previous_waypoint(self):
        self.tell("previous_waypoint")

    def jog(self, step_world):
        self.tell("jog")
        self.steps.append(step_world)
        self.jogging = True

    def open_gripper(self):
        self.tell("open_gripper")
        self.gripper = "open"

    def close_gripper(self):
        self.tell("close_gripper")
        self.gripper = "closed"

    def set_speed(self, share):
        self.tell("set_speed")
        self.speed = share

    def close(self):
        self.hold("closed")


class Scene:
    """A policy on a clock that goes on as it is told, and touches on the skin."""

    def __init__(self, commands=DEFAULT, **config):
        self.clock = ManualClock()
        self.arm = ToldArm(self.clock)
        self.said = []
        config = PolicyConfig(check_period=None, **config)
        self.policy = Policy(self.arm, commands, VOCABULARY, config)
        self.policy.start(Context(INFO, self.clock, self.said.append))
        self.touches = {}
        self.count = 0
        self.out = ()
        self.silent = ()

    def moment(self, over=()):
        """The next reading of the skin."""
        self.clock.sleep(PERIOD / SECOND)
        now = self.clock.now()
        for touch in self.touches.values():
            touch["last"] = now if touch["felt"] else touch["last"]
        rows = np.zeros(len(self.touches), TOUCH)
        for row, (number, touch) in zip(rows, self.touches.items(), strict=True):
            row["id"], row["onset"], row["last"] = number, touch["onset"], touch["last"]
            row["force"] = touch["force"]
        going = tuple(
            TouchStatus(number, touch["onset"], touch["last"], 0, 0)
            for number, touch in self.touches.items()
        )
        faults = tuple(Fault("patch", p, None, None, None, now) for p in self.out)
        valid = np.ones(SKIN.count, np.bool_)
        names = [patch.id for patch in SKIN.patches]
        for patch in self.silent:
            valid[np.asarray(SKIN.patch_index) == names.index(patch)] = False
        reading = Reading(now, np.zeros(SKIN.count, np.float32), valid, Q)
        packed = pack(NO_TOUCHES._replace(touches=rows))
        state = TouchState(
            reading, faults, TrackingResult(packed, going, over), MOUNTED
        )
        chances = {n: self.chances(t) for n, t in self.touches.items()}
        self.policy.on_message(RecognitionState(state, chances, ()))

    @staticmethod
    def chances(touch):
        chances = np.full(len(VOCABULARY), (1 - touch["sure"]) / 4)
        chances[VOCABULARY.index(touch["gesture"])] = touch["sure"]
        return chances

    def rest(self, seconds):
        for _ in range(round(seconds * SECOND / PERIOD)):
            self.moment()

    def touch(self, gesture="poke", sure=0.99, force=5.0, number=None):
        """Begin to touch; the id of the touch."""
        self.count += 1
        number = self.count if number is None else number
        self.touches[number] = {
            "onset": self.clock.now() + PERIOD,
            "last": self.clock.now() + PERIOD,
            "felt": True,
            "force": force,
            "gesture": gesture,
            "sure": sure,
            "way": np.zeros(3) if gesture != "stroke" else WAY,
        }
        return number

    def lift(self, number):
        self.touches[number]["felt"] = False

    def close(self, number, heir=0):
        touch = self.touches.pop(number)
        self.moment((TouchStatus(number, touch["onset"], touch["last"], heir, 1),))

    def detect(
        self, number, age=0.0, sure=None, patch=PATCH, gesture=None, likeliest=""
    ):
        """Say what a touch is; the decisions that follow at once."""
        touch, before = self.touches[number], len(self.said)
        stamp = self.clock.now() - round(age * SECOND)
        self.policy.on_message(
            Detection(
                stamp=stamp,
                touch=number,
                gesture=gesture or touch["gesture"],
                confidence=touch["sure"] if sure is None else sure,
                onset=touch["onset"],
                end=touch["last"],
                link=patch.link,
                patch=patch.id,
                p_world=np.zeros(3),
                n_world=np.zeros(3),
                direction_world=touch["way"],
                peak_force=touch["force"],
                likeliest=likeliest,
            )
        )
        return self.said[before:]

    def whole(self, gesture="poke", sure=0.99, seconds=0.3, force=5.0):
        """A touch from its beginning to its closing; the decisions on the way."""
        before = len(self.said)
        number = self.touch(gesture, sure, force)
        self.rest(seconds)
        self.detect(number)
        self.rest(0.1)
        self.lift(number)
        self.rest(0.5)
        self.close(number)
        return self.said[before:]
