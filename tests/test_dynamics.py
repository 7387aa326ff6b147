"""An arm with masses and servos: it follows, yields, and stops by itself."""

import json
import sys

import numpy as np
import pytest

from eskin.cli.main import run
from eskin.command import (
    FRAME_TASK,
    DynamicPlant,
    MotionConfig,
    ProtectiveStopConfig,
    SimulatedArm,
    load_commands,
)
from eskin.demo import LiveSource, SimulatedUser, SimulatedUserConfig
from eskin.demo.browser import PageCommandHandler
from eskin.drivers import ManualClock
from eskin.errors import ArmError, ExtraError, RobotError
from eskin.page import PageOrder
from eskin.robot import Dynamics, Kinematics, ServoConfig, Wrench, load_robot
from eskin.robot.presets import read_preset_urdf
from eskin.sim.interactive import InteractiveSkin, LinkPoint
from eskin.sim.interactive.skin import compute_wrenches
from eskin.transforms import apply
from helpers.commands import VOCABULARY

mujoco = pytest.importorskip("mujoco", reason="needs the extra sim")

CONFIG = MotionConfig()
LIMITS = ProtectiveStopConfig()
ELBOW_TO_WRIST = np.array([0.0, 0.0, 0.3])
STRETCHED = np.zeros(6)
EFFORT = np.array([150.0, 150.0, 150.0, 28.0, 28.0, 28.0])


def arm_and_clock():
    clock = ManualClock()
    return SimulatedArm(clock=clock, plant=DynamicPlant()), clock


def pushed(force, point=ELBOW_TO_WRIST, link="forearm_link"):
    """A force [N] at a point of a link, both in its frame."""
    force = np.array(force, np.float64)
    return [Wrench(link, force, np.cross(point, force))]


def off(arm):
    """How far the joints are from their set-points [rad]."""
    return np.abs(arm.state().q - arm.executor.trajectory.q).max()


def tensor_of(body):
    """Inertia about the centre of mass, along the axes of the link [kg m2]."""
    R_link_axes = np.zeros(9)
    mujoco.mju_quat2Mat(R_link_axes, body.iquat)
    R_link_axes = R_link_axes.reshape(3, 3)
    return R_link_axes @ np.diag(body.inertia) @ R_link_axes.T


def test_inertias_of_the_ur5_are_those_of_uniform_cylinders():
    uniform, given = (
        mujoco.MjSpec.from_string(read_preset_urdf("ur5")) for _ in range(2)
    )
    given.compiler.fusestatic = uniform.compiler.fusestatic = False
    uniform.compiler.inertiafromgeom = mujoco.mjtInertiaFromGeom.mjINERTIAFROMGEOM_TRUE
    uniform, given = uniform.compile(), given.compile()
    masses = []
    for link in load_robot("ur5").link_names[1:-1]:
        alike, ours = uniform.body(link), given.body(link)
        wanted = tensor_of(alike) * ours.mass / alike.mass
        np.testing.assert_allclose(
            tensor_of(ours), wanted, atol=1e-3 * np.abs(wanted).max()
        )
        masses += ours.mass.tolist()
    assert masses == [3.7, 8.393, 2.33, 1.219, 1.219, 0.1879]


def test_it_follows_its_task_closely_within_its_torques_and_never_stops_itself():
    arm, clock = arm_and_clock()
    plant, brought = arm.plant, arm.state().delivered
    for _ in range(2000):
        clock.sleep(0.01)
        state = arm.state()
        assert off(arm) < 0.01 and not state.protective_stop
        assert (np.abs(plant.dynamics.torque) <= EFFORT).all()
    assert state.delivered > brought


def test_at_rest_it_is_where_the_kinematic_arm_is():
    (arm, clock), others = arm_and_clock(), ManualClock()
    other = SimulatedArm(clock=others)
    for seconds in (3.0, 0.7):
        for _ in range(round(seconds / 0.002)):
            others.sleep(0.002)
            other.state()
        clock.sleep(seconds)
        arm.pause()
        other.pause()
        clock.sleep(1.0)
        others.sleep(1.0)
        np.testing.assert_allclose(arm.state().q, other.state().q, atol=1e-3)
        arm.resume()
        other.resume()


@pytest.mark.parametrize("payload", [0.0, 5.0])
def test_gravity_does_not_make_it_sag(payload):
    dynamics = Dynamics("ur5", STRETCHED, ServoConfig(payload=payload))
    for _ in range(1000):
        dynamics.step(STRETCHED, np.zeros(6))
    assert np.abs(dynamics.q).max() < 1e-6
    assert np.abs(dynamics.torque).max() > 50


@pytest.mark.parametrize("seconds", [1.6, 3.0, 4.1])
def test_a_pause_stops_it_soon_and_the_set_points_wait(seconds):
    arm, clock = arm_and_clock()
    clock.sleep(seconds)
    arm.pause()
    clock.sleep(CONFIG.brake_seconds)
    assert off(arm) < LIMITS.deviation
    stood = arm.executor.trajectory.q
    clock.sleep(0.3)
    assert not arm.state().moving
    clock.sleep(5.0)
    np.testing.assert_array_equal(arm.executor.trajectory.q, stood)
    np.testing.assert_allclose(arm.state().q, stood, atol=1e-6)


def lever_of(q, link, force, point):
    """How much a force in a link's frame turns each joint [Nm], by virtual work."""
    robot = load_robot("ur5")
    kinematics, index = Kinematics(robot), robot.link_index(link)
    T_world_link = kinematics.poses(q)[index]
    steps = 1e-6 * np.eye(6)
    ends = [kinematics.poses(q + sign * steps)[:, index] for sign in (1, -1)]
    ahead, behind = (apply(T, np.tile(point, (6, 1))) for T in ends)
    return (ahead - behind) / 2e-6 @ (T_world_link[:3, :3] @ force)


@pytest.mark.parametrize("force", [(40.0, 0.0, 0.0), (0.0, 40.0, 0.0)])
def test_a_push_turns_joints_by_lever_over_stiffness_and_is_forgotten(force):
    arm, clock = arm_and_clock()
    arm.pause()
    clock.sleep(1.0)
    stood = arm.state().q
    arm.apply_wrenches(pushed(force))
    clock.sleep(2.0)
    yielded = arm.state().q - stood
    torque = lever_of(stood, "forearm_link", np.array(force), ELBOW_TO_WRIST)
    wanted = torque / arm.plant.dynamics.config.stiffness
    np.testing.assert_allclose(yielded, wanted, atol=0.05 * np.abs(wanted).max())
    assert np.abs(yielded).max() > 1e-3
    arm.apply_wrenches([])
    clock.sleep(2.0)
    np.testing.assert_allclose(arm.state().q, stood, atol=1e-6)
    assert not arm.state().protective_stop


def test_a_hard_push_stops_it_for_good_until_a_person_unlocks_it():
    arm, clock = arm_and_clock()
    arm.apply_wrenches(pushed((600.0, 0.0, 0.0)))
    shares = []
    for _ in range(100):
        clock.sleep(0.01)
        arm.state()
        shares.append(np.abs(arm.plant.dynamics.torque) / EFFORT)
    assert np.max(shares) == 1.0
    arm.apply_wrenches([])
    clock.sleep(0.5)
    state = arm.state()
    arm.apply_wrenches(pushed((200.0, 0.0, 0.0)))
    clock.sleep(2.0)
    np.testing.assert_allclose(arm.state().q, state.q, atol=1e-3)
    arm.apply_wrenches([])
    state = arm.state()
    assert state.protective_stop and state.hold_reason == "protective stop"
    for tell in (arm.resume, arm.next_waypoint, arm.open_gripper):
        tell()
        clock.sleep(2.0)
        np.testing.assert_allclose(arm.state().q, state.q, atol=1e-6)
    with pytest.raises(ArmError, match="held: protective stop; allowed is"):
        arm.release()
    arm.unlock()
    clock.sleep(1.0)
    assert arm.state().hold_reason and not arm.state().protective_stop
    np.testing.assert_allclose(arm.state().q, state.q, atol=1e-6)
    arm.release()
    clock.sleep(2.0)
    assert np.abs(arm.state().q - state.q).max() > 0.1 and off(arm) < 0.01


def test_a_knock_that_is_over_soon_stops_nothing():
    arm, clock = arm_and_clock()
    arm.apply_wrenches(pushed((600.0, 0.0, 0.0)))
    clock.sleep(0.04)
    arm.apply_wrenches([])
    clock.sleep(2.0)
    assert not arm.state().stopped and off(arm) < 0.01


def test_it_does_the_same_however_often_it_is_looked_at():
    ends = []
    for look in (0.0037, 0.05, 1.0):
        arm, clock = arm_and_clock()
        for tell in (arm.pause, arm.resume, arm.next_waypoint):
            until = clock.now() + 1_000_000_000
            while clock.now() < until:
                clock.sleep(min(look, (until - clock.now()) / 1e9))
                arm.state()
            tell()
            arm.apply_wrenches(pushed((30.0, 0.0, 5.0)))
        clock.sleep(1.0)
        ends.append(arm.state().q)
    np.testing.assert_array_equal(ends[0], ends[1])
    np.testing.assert_array_equal(ends[0], ends[2])


def test_nothing_moves_the_kinematic_arm():
    clock, others = ManualClock(), ManualClock()
    arm, other = SimulatedArm(clock=clock), SimulatedArm(clock=others)
    arm.apply_wrenches(pushed((600.0, 0.0, 0.0)))
    arm.unlock()
    clock.sleep(3.0)
    others.sleep(3.0)
    np.testing.assert_array_equal(arm.state().q, other.state().q)


def test_pressure_pushes_inward_with_its_force_where_it_is():
    skin = InteractiveSkin().mounted.skin
    taxels = skin.find_taxels("forearm_front")[:1]
    (wrench,) = compute_wrenches(np.array([50.0]), taxels, skin)
    force = -50e3 * skin.areas[taxels[0]] * skin.normals[taxels[0]]
    np.testing.assert_allclose(wrench.force_link, force)
    moment = np.cross(skin.positions[taxels[0]], force)
    np.testing.assert_allclose(wrench.torque_link, moment)
    assert wrench.link == "forearm_link"
    assert compute_wrenches(np.zeros(0), taxels[:0], skin) == ()


def test_an_arm_that_stands_yields_to_a_poke_on_its_skin():
    arm, clock = arm_and_clock()
    skin = InteractiveSkin(loses=False)
    arm.pause()
    source = LiveSource(
        skin, arm, clock, after_scan=lambda: arm.apply_wrenches(skin.wrenches)
    )
    for _ in range(10):
        stood = source.read().q
    taxel = skin.mounted.skin.find_taxels("forearm_front")[200]
    place = LinkPoint("forearm_link", skin.mounted.skin.positions[taxel])
    touch = skin.hand.poke(place, 30.0, 0.5)
    yielded = felt = 0.0
    while touch in skin.hand.touching:
        yielded = max(yielded, np.abs(source.read().q - stood).max())
        felt = max(felt, *(np.linalg.norm(w.force_link) for w in skin.wrenches), 0.0)
    assert felt == pytest.approx(30.0, rel=0.2)
    assert 1e-3 < yielded < 0.05
    for _ in range(50):
        left = np.abs(source.read().q - stood).max()
    assert left < 1e-6


def test_who_touches_the_arm_of_the_demonstration_pushes_it(capsys, monkeypatch):
    forces, push = [0.0], DynamicPlant.apply_wrenches

    def noted(plant, wrenches):
        forces.extend(np.linalg.norm(wrench.force_link) for wrench in wrenches)
        push(plant, wrenches)

    monkeypatch.setattr(DynamicPlant, "apply_wrenches", noted)
    argv = ["demo", "--headless", "--dynamics", "--seed", "103", "--seconds", "5"]
    assert run([*argv, "--json"]) == 0
    told = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert told["seconds"] == 5.0
    assert max(forces) > 1.0


def test_resume_in_the_page_ends_a_protective_stop():
    arm, clock = arm_and_clock()
    handler = PageCommandHandler(InteractiveSkin(), arm)
    arm.apply_wrenches(pushed((600.0, 0.0, 0.0)))
    clock.sleep(0.5)
    arm.apply_wrenches([])
    assert arm.state().protective_stop
    handler.handle(PageOrder("resume_task"))
    assert not arm.state().stopped


def test_people_unlock_an_arm_in_protective_stop_before_they_touch_it():
    arm, clock = arm_and_clock()
    skin = InteractiveSkin()
    commands = load_commands(None, VOCABULARY, skin.mounted.skin)
    user = SimulatedUser(skin, arm, commands, 0, SimulatedUserConfig(first=0.1))
    arm.apply_wrenches(pushed((600.0, 0.0, 0.0)))
    clock.sleep(0.5)
    arm.apply_wrenches([])
    assert arm.state().protective_stop
    while not skin.hand.touching:
        clock.sleep(0.02)
        user.update(clock.now())
    assert user.unlocked == 1 and not arm.state().protective_stop
    assert arm.state().hold_reason == "protective stop"


def test_a_robot_without_masses_is_refused():
    with pytest.raises(RobotError, match="has no <inertial>; allowed"):
        Dynamics("ur10", STRETCHED)


def test_who_lacks_mujoco_is_told_how_to_get_it(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(ExtraError, match="pip install 'eskin\\[sim\\]'"):
        DynamicPlant(FRAME_TASK)
    assert run(["demo", "--dynamics", "--headless"]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "--dynamics needs MuJoCo" in line and "pip install 'eskin[sim]'" in line


def test_the_same_touch_has_no_dynamics(capsys):
    assert run(["demo", "--same-touch", "--dynamics"]) == 2
    assert "dynamics on; allowed" in capsys.readouterr().err
