"""Tests of an arm with masses and servos: it follows, yields and stops by itself."""

import re
import sys

import numpy as np
import pytest

from eskin.arms import (
    FRAME_TASK,
    DynamicPlant,
    Dynamics,
    MotionConfig,
    ProtectiveStopConfig,
    ServoConfig,
    SimulatedArm,
    Wrench,
)
from eskin.cli.main import run
from eskin.command import Problem, load_commands
from eskin.drivers import ManualClock
from eskin.errors import ArmError, ExtraError, RobotError
from eskin.page import PageOrder
from eskin.registry import advise_install
from eskin.robot import Kinematics, load_robot
from eskin.robot.presets import read_preset_urdf
from eskin.sim.demo import (
    DemoConfig,
    LiveSource,
    SimulatedUser,
    SimulatedUserConfig,
    run_headless,
)
from eskin.sim.demo.browser import PageOrderHandler
from eskin.sim.interactive import InteractiveSkin, LinkPoint
from eskin.sim.interactive.skin import compute_wrenches
from eskin.transforms import apply
from helpers.commands import VOCABULARY

pytestmark = pytest.mark.slow

mujoco = pytest.importorskip("mujoco", reason="needs the extra sim")

ELBOW_TO_WRIST = np.array([0.0, 0.0, 0.3])
STRETCHED = np.zeros(6)
EFFORT = np.array([150.0, 150.0, 150.0, 28.0, 28.0, 28.0])
LINK = "forearm_link"


def make_arm(dynamic=True):
    plant = DynamicPlant() if dynamic else None
    return SimulatedArm(clock=ManualClock(), plant=plant)


@pytest.fixture
def arm():
    return make_arm()


@pytest.fixture
def stopped_arm(arm):
    """An arm that a hard push has put into protective stop."""
    push(arm, 600.0, seconds=0.5)
    assert arm.state().protective_stop
    return arm


def push(arm, *force, seconds):
    """Push the forearm with a force in its frame [N], then let go."""
    force = np.array((*force, 0.0, 0.0)[:3])
    arm.apply_wrenches([Wrench(LINK, force, np.cross(ELBOW_TO_WRIST, force))])
    arm.clock.sleep(seconds)
    arm.apply_wrenches([])


def measure_deviation(arm):
    """Return how far the joints are from their set-points [rad]."""
    return np.abs(arm.state().q - arm.executor.trajectory.q).max()


def inertia_tensor(body):
    """Return the inertia about the centre of mass, in axes of the link [kg m2]."""
    R_link_axes = np.zeros(9)
    mujoco.mju_quat2Mat(R_link_axes, body.iquat)
    R_link_axes = R_link_axes.reshape(3, 3)
    return R_link_axes @ np.diag(body.inertia) @ R_link_axes.T


def test_inertias_of_ur5_are_those_of_uniform_cylinders():
    uniform, given = (
        mujoco.MjSpec.from_string(read_preset_urdf("ur5")) for _ in range(2)
    )
    given.compiler.fusestatic = uniform.compiler.fusestatic = False
    uniform.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    uniform = uniform.compile()
    given = given.compile()
    masses = []
    for link in load_robot("ur5").link_names[1:-1]:
        alike = uniform.body(link)
        ours = given.body(link)
        wanted = inertia_tensor(alike) * ours.mass / alike.mass
        tolerance = 1e-3 * np.abs(wanted).max()
        np.testing.assert_allclose(inertia_tensor(ours), wanted, atol=tolerance)
        masses += ours.mass.tolist()
    assert masses == [3.7, 8.393, 2.33, 1.219, 1.219, 0.1879]


@pytest.mark.parametrize("payload", [0.0, 5.0])
def test_gravity_is_compensated(payload):
    dynamics = Dynamics("ur5", STRETCHED, ServoConfig(payload=payload))
    for _ in range(500):
        dynamics.step(STRETCHED, np.zeros(6))
    assert np.abs(dynamics.q).max() < 1e-6
    assert np.abs(dynamics.torque).max() > 50


def test_robot_without_masses_is_refused():
    with pytest.raises(RobotError, match="<inertial>"):
        Dynamics("ur10", STRETCHED)


def test_arm_follows_task_within_its_torques(arm):
    for _ in range(750):
        arm.clock.sleep(0.02)
        assert measure_deviation(arm) < 0.01 and not arm.state().protective_stop
        assert (np.abs(arm.plant.dynamics.torque) <= EFFORT).all()
    assert arm.state().delivered >= 1


def test_paused_arm_rests_where_kinematic_arm_does(arm):
    other = make_arm(dynamic=False)
    for each in (arm, other):
        for _ in range(100):
            each.clock.sleep(0.02)
            each.state()
        each.pause()
        each.clock.sleep(MotionConfig().brake_seconds)
    assert measure_deviation(arm) < ProtectiveStopConfig().deviation
    arm.clock.sleep(0.3)
    assert not arm.state().moving
    arm.clock.sleep(2.0)
    q = arm.executor.trajectory.q
    np.testing.assert_allclose(arm.state().q, q, atol=1e-6)
    np.testing.assert_allclose(other.state().q, q, atol=1e-2)


def joint_torques(q, force):
    """Return what a force on the forearm turns each joint by [Nm], by virtual work."""
    robot = load_robot("ur5")
    kinematics = Kinematics(robot)
    index = robot.link_index(LINK)
    steps = 1e-6 * np.eye(6)
    ends = [kinematics.poses(q + sign * steps)[:, index] for sign in (1, -1)]
    ahead, behind = (apply(T, np.tile(ELBOW_TO_WRIST, (6, 1))) for T in ends)
    R_world_link = kinematics.poses(q)[index][:3, :3]
    return (ahead - behind) / 2e-6 @ (R_world_link @ np.array(force))


@pytest.mark.parametrize("force", [(40.0, 0.0, 0.0), (0.0, 40.0, 0.0)])
def test_push_turns_joints_by_torque_over_stiffness(arm, force):
    arm.pause()
    arm.clock.sleep(1.0)
    stood = arm.state().q
    push(arm, *force, seconds=1.5)
    yielded = arm.state().q - stood
    wanted = joint_torques(stood, force) / arm.plant.dynamics.config.stiffness
    np.testing.assert_allclose(yielded, wanted, atol=0.05 * np.abs(wanted).max())
    assert np.abs(yielded).max() > 1e-3
    arm.clock.sleep(1.5)
    np.testing.assert_allclose(arm.state().q, stood, atol=1e-6)
    assert not arm.state().protective_stop


def test_protective_stop_lasts_until_unlocked_and_released(stopped_arm):
    arm = stopped_arm
    arm.clock.sleep(0.5)
    stood = arm.state()
    assert stood.hold_reason == Problem.PROTECTIVE_STOP.reason()
    push(arm, 200.0, seconds=1.0)
    np.testing.assert_allclose(arm.state().q, stood.q, atol=1e-3)
    stood = arm.state()
    for order in (arm.resume, arm.next_waypoint, arm.open_gripper, arm.unlock):
        if order == arm.unlock:
            with pytest.raises(ArmError, match="protective stop"):
                arm.release()
        order()
        arm.clock.sleep(0.7)
        np.testing.assert_allclose(arm.state().q, stood.q, atol=1e-6)
    assert arm.state().hold_reason and not arm.state().protective_stop
    arm.release()
    arm.clock.sleep(2.0)
    assert np.abs(arm.state().q - stood.q).max() > 0.1 and measure_deviation(arm) < 0.01


def test_short_knock_stops_nothing(arm):
    push(arm, 600.0, seconds=0.04)
    assert np.abs(arm.plant.dynamics.torque / EFFORT).max() == 1.0
    arm.clock.sleep(2.0)
    assert not arm.state().stopped and measure_deviation(arm) < 0.01


def test_dynamics_are_independent_of_queries():
    ends = []
    for step in (0.0137, 1.0):
        arm = make_arm()
        for order in (arm.pause, arm.resume, arm.next_waypoint):
            end = arm.clock.now() + 500_000_000
            while (left := (end - arm.clock.now()) / 1e9) > 0:
                arm.clock.sleep(min(step, left))
                arm.state()
            order()
            push(arm, 30.0, 0.0, 5.0, seconds=0.3)
        ends.append(arm.state().q)
    np.testing.assert_array_equal(*ends)


def test_kinematic_arm_ignores_pushes():
    arm = make_arm(dynamic=False)
    other = make_arm(dynamic=False)
    push(arm, 600.0, seconds=3.0)
    arm.unlock()
    other.clock.sleep(3.0)
    np.testing.assert_array_equal(arm.state().q, other.state().q)


def test_pressure_becomes_wrench_along_inward_normal():
    skin = InteractiveSkin().mounted.skin
    taxels = skin.find_taxels("forearm_front")[:1]
    (wrench,) = compute_wrenches(np.array([50.0]), taxels, skin)
    force = -50e3 * skin.areas[taxels[0]] * skin.normals[taxels[0]]
    np.testing.assert_allclose(wrench.force_link, force)
    moment = np.cross(skin.positions[taxels[0]], force)
    np.testing.assert_allclose(wrench.torque_link, moment)
    assert wrench.link == LINK
    assert compute_wrenches(np.zeros(0), taxels[:0], skin) == ()


def test_standing_arm_yields_to_poke_on_its_skin(arm):
    skin = InteractiveSkin(loses=False)
    arm.pause()
    source = LiveSource(
        skin, arm, arm.clock, after_scan=lambda: arm.apply_wrenches(skin.wrenches)
    )
    for _ in range(10):
        stood = source.read().q
    taxel = skin.mounted.skin.find_taxels("forearm_front")[200]
    place = LinkPoint(LINK, skin.mounted.skin.positions[taxel])
    touch = skin.hand.poke(place, 30.0, 0.5)
    yielded = 0.0
    forces = [0.0]
    while touch in skin.hand.touching:
        yielded = max(yielded, np.abs(source.read().q - stood).max())
        forces += [np.linalg.norm(wrench.force_link) for wrench in skin.wrenches]
    assert max(forces) == pytest.approx(30.0, rel=0.2)
    assert 1e-3 < yielded < 0.05
    for _ in range(50):
        left = np.abs(source.read().q - stood).max()
    assert left < 1e-6


def test_touches_of_demonstration_push_arm(monkeypatch):
    forces = [0.0]
    apply_wrenches = DynamicPlant.apply_wrenches

    def record(plant, wrenches):
        forces.extend(np.linalg.norm(wrench.force_link) for wrench in wrenches)
        apply_wrenches(plant, wrenches)

    monkeypatch.setattr(DynamicPlant, "apply_wrenches", record)
    user = SimulatedUserConfig(first=0.1)
    result = run_headless(1.0, DemoConfig(seed=103, dynamics=True, user=user))
    assert result.seconds == 1.0 and max(forces) > 1.0


def test_resume_button_ends_protective_stop(stopped_arm):
    handler = PageOrderHandler(InteractiveSkin(), stopped_arm)
    handler.handle(PageOrder("resume_task"))
    assert not stopped_arm.state().stopped


def test_simulated_user_unlocks_arm_before_touching(stopped_arm):
    arm = stopped_arm
    skin = InteractiveSkin()
    commands = load_commands(None, VOCABULARY, skin.mounted.skin)
    user = SimulatedUser(skin, arm, commands, 0, SimulatedUserConfig(first=0.1))
    while not skin.hand.touching:
        arm.clock.sleep(0.02)
        user.update(arm.clock.now())
    assert user.unlocked == 1 and not arm.state().protective_stop
    assert arm.state().hold_reason == Problem.PROTECTIVE_STOP.reason()


def test_missing_mujoco_is_named_with_what_installs_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ExtraError, match=re.escape(advise_install("sim"))):
        DynamicPlant(FRAME_TASK)
    assert run(["demo", "--dynamics", "--headless"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--dynamics" in line and advise_install("sim") in line
