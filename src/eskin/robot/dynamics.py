"""This module simulates a robot with masses and joint servos in MuJoCo (extra `sim`)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from jaxtyping import Float

from eskin.errors import RobotError
from eskin.extras import find_mujoco
from eskin.robot.presets import load_robot, read_preset_urdf


@dataclass(frozen=True, eq=False)
class Wrench:
    """A force and a torque on a link, in its own frame."""

    link: str
    """Which one."""
    force_link: Float[np.ndarray, "3"]
    """[N]"""
    torque_link: Float[np.ndarray, "3"]
    """About the origin of the link [Nm]."""


HARDEST = 0.9999
"""Of MuJoCo's constraints, by which brakes creep least (`solimp`)."""


@dataclass(frozen=True)
class ServoConfig:
    """Joint servos, and what the robot carries; the defaults are for a UR5.

    UR does not publish its gains. The stiffness is chosen: 100 N, to which a UR5 yields
    without a stop, turn no joint of a stretched arm by 0.05 rad. The damping is about
    critical in a bent arm. The rotors are those of the UR5e of MuJoCo Menagerie.
    """

    stiffness: tuple[float, ...] = (2000.0, 2000.0, 2000.0, 500.0, 500.0, 500.0)
    """Torque by angle of each joint [Nm/rad]."""

    damping: tuple[float, ...] = (120.0, 120.0, 120.0, 15.0, 15.0, 15.0)
    """Torque by speed of each joint [Nm s/rad]."""

    rotor: float = 0.1
    """Inertia of a joint's rotor, seen from behind its gear [kg m2]."""

    tool: str = "tool0"
    """Link that carries the gripper."""

    payload: float = 0.9
    """Of the gripper, such as a Robotiq 2F-85; what it grips weighs nothing [kg]."""

    payload_out: float = 0.06
    """How far the gripper's centre of mass is from the flange [m]."""

    step: float = 0.002
    """Of physics and servos [s]."""


@final
class Dynamics:
    """A robot on its servos: torque by position and velocity, with gravity compensated.

    The joints' torques stay within the efforts of the URDF. Nothing meets: neither
    links nor table nor parts. There is no friction but that of the brakes, whose
    clutches slip above the effort of their joint.

    Attributes:
        config: of the servos.
        effort: greatest torque of each joint [Nm].
    """

    def __init__(
        self,
        robot_name: str,
        q: Float[np.ndarray, "joint"],
        config: ServoConfig | None = None,
    ) -> None:
        """Stand at joint positions.

        Args:
            robot_name: of a preset robot whose links have masses.
            q: joint positions [rad].
            config: of the servos.

        Raises:
            RobotError: there is no such robot, or a link of it has no mass.
            ExtraError: MuJoCo is not installed.
        """
        self.mujoco = find_mujoco("an arm with dynamics")
        self.config = config or ServoConfig()
        self.model = self.build(robot_name)
        self.data = self.mujoco.MjData(self.model)
        self.data.qpos[:] = q
        self.effort = np.array(self.model.jnt_actfrcrange[:, 1])
        self.lead = np.divide(self.config.damping, self.config.stiffness)
        self.mujoco.mj_forward(self.model, self.data)

    def build(self, robot_name: str) -> Any:  # noqa: ANN401 (a type of MuJoCo)
        """The robot's model, with servos in the order of `q`."""
        mujoco, config = self.mujoco, self.config
        spec = mujoco.MjSpec.from_string(read_preset_urdf(robot_name))
        spec.compiler.fusestatic = False
        spec.option.timestep = config.step
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
        for body in spec.bodies:
            body.gravcomp = 1.0
            if body.joints and not body.explicitinertial:
                raise RobotError(
                    f"robot '{robot_name}': link '{body.name}' has no <inertial>; "
                    "allowed with dynamics are links with masses; give it one"
                )
        tool = spec.body(config.tool)
        tool.mass, tool.ipos = config.payload, (0.0, 0.0, config.payload_out)
        tool.inertia = np.full(3, config.payload * config.payload_out**2 / 3)
        tool.explicitinertial = True
        names = load_robot(robot_name).joint_names
        gains = zip(names, config.stiffness, config.damping, strict=True)
        for name, stiffness, damping in gains:
            joint = spec.joint(name)
            joint.armature, joint.actgravcomp = config.rotor, True
            servo = spec.add_actuator(name=name, target=name)
            servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
            servo.set_to_position(kp=stiffness, kv=damping)
        model = spec.compile()
        model.dof_solimp[:, :2] = HARDEST
        model.dof_solref[:, 0] = 2 * config.step
        return model

    @property
    def q(self) -> Float[np.ndarray, "joint"]:
        """Joint positions now [rad]."""
        return self.data.qpos.copy()

    @property
    def velocity(self) -> Float[np.ndarray, "joint"]:
        """Joint speeds now [rad/s]."""
        return self.data.qvel.copy()

    @property
    def torque(self) -> Float[np.ndarray, "joint"]:
        """What the servos gave in the last step, gravity and all [Nm]."""
        return self.data.qfrc_actuator.copy()

    def step(
        self,
        q: Float[np.ndarray, "joint"],
        velocity: Float[np.ndarray, "joint"],
    ) -> None:
        """Let a step pass, with set-points for positions [rad] and speeds [rad/s]."""
        self.data.ctrl[:] = q + self.lead * velocity
        self.mujoco.mj_step(self.model, self.data)

    def push(self, wrenches: Sequence[Wrench]) -> None:
        """Be pushed so, and not otherwise, until told anew.

        What pushes keeps its direction and its distance from the centre of mass in the
        world, whatever the link does meanwhile.
        """
        data = self.data
        data.xfrc_applied[:] = 0.0
        for wrench in wrenches:
            body = self.model.body(wrench.link).id
            R_world_link = data.xmat[body].reshape(3, 3)
            force = R_world_link @ wrench.force_link
            lever = data.xpos[body] - data.xipos[body]
            torque = R_world_link @ wrench.torque_link + np.cross(lever, force)
            data.xfrc_applied[body] += np.concatenate([force, torque])

    def brake(self) -> None:
        """Let the brakes fall in."""
        self.model.dof_frictionloss[:] = self.effort

    def release(self) -> None:
        """Open the brakes."""
        self.model.dof_frictionloss[:] = 0.0
