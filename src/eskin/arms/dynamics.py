"""This module simulates a robot with masses and servos in MuJoCo (extra `sim`)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, final

import numpy as np
from jaxtyping import Float

from eskin.errors import RobotError
from eskin.registry import find_mujoco
from eskin.robot.presets import load_robot, read_preset_urdf


@dataclass(frozen=True, eq=False)
class Wrench:
    """A wrench is a force and a torque that act on a link, in the link's frame."""

    link: str
    force_link: Float[np.ndarray, "3"]
    """Force [N]."""
    torque_link: Float[np.ndarray, "3"]
    """Torque about the origin of the link [Nm]."""


BRAKE_IMPEDANCE = 0.9999
"""Impedance of the brakes' constraints (`solimp`), the largest that MuJoCo allows: it
makes them creep least."""


@dataclass(frozen=True)
class ServoConfig:
    """A configuration describes servos and payload; the defaults suit a UR5.

    UR does not publish its gains. The stiffness is chosen such that 100 N on a
    stretched arm, which a UR5 withstands without a stop, deflect no joint by 0.05 rad.
    The damping is about critical in a bent arm. The rotor inertia is that of the UR5e
    in MuJoCo Menagerie.
    """

    stiffness: tuple[float, ...] = (2000.0, 2000.0, 2000.0, 500.0, 500.0, 500.0)
    """Stiffness of each joint [Nm/rad]."""
    damping: tuple[float, ...] = (120.0, 120.0, 120.0, 15.0, 15.0, 15.0)
    """Damping of each joint [Nm s/rad]."""
    rotor_inertia: float = 0.1
    """Inertia of a joint's rotor on the output side of the gear [kg m2]."""
    tool: str = "tool0"
    """Link that carries the gripper."""
    payload: float = 0.9
    """Mass of the gripper, such as a Robotiq 2F-85, without load [kg]."""
    payload_offset: float = 0.06
    """Distance of the gripper's centre of mass from the flange [m]."""
    step: float = 0.002
    """Time step of physics and servos [s]."""


@final
class Dynamics:
    """Dynamics simulate a robot with position servos and gravity compensation.

    Joint torques are limited by the efforts of the URDF. There are no contacts, and no
    friction but that of the brakes, which slip above the effort of their joint.

    Attributes:
        config: configuration of servos and payload.
        effort: largest torque of each joint [Nm].
    """

    def __init__(
        self,
        robot_name: str,
        q: Float[np.ndarray, "joint"],
        config: ServoConfig | None = None,
    ) -> None:
        """Start at rest at given joint positions.

        Args:
            robot_name: name of a preset robot whose links have masses.
            q: joint positions [rad].
            config: configuration of servos and payload.

        Raises:
            RobotError: There is no such robot, or one of its links has no mass.
            ExtraError: MuJoCo is not installed.
        """
        self.mujoco = find_mujoco("an arm with dynamics")
        self.config = config or ServoConfig()
        self.model = self.build_model(robot_name)
        self.data = self.mujoco.MjData(self.model)
        self.data.qpos[:] = q
        self.effort = np.array(self.model.jnt_actfrcrange[:, 1])
        # With this feedforward, the servos damp only the error of the velocity.
        self.feedforward = np.divide(self.config.damping, self.config.stiffness)
        self.mujoco.mj_forward(self.model, self.data)

    def build_model(self, robot_name: str) -> Any:  # noqa: ANN401 (a type of MuJoCo)
        """Build the robot's MuJoCo model, with servos in the order of `q`."""
        mujoco = self.mujoco
        config = self.config
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
                    "allowed with dynamics are links with masses"
                )
        tool = spec.body(config.tool)
        tool.mass = config.payload
        tool.ipos = (0.0, 0.0, config.payload_offset)
        tool.inertia = np.full(3, config.payload * config.payload_offset**2 / 3)
        tool.explicitinertial = True
        names = load_robot(robot_name).joint_names
        for name, stiffness, damping in zip(
            names, config.stiffness, config.damping, strict=True
        ):
            joint = spec.joint(name)
            joint.armature = config.rotor_inertia
            joint.actgravcomp = True
            servo = spec.add_actuator(name=name, target=name)
            servo.trntype = mujoco.mjtTrn.mjTRN_JOINT
            servo.set_to_position(kp=stiffness, kv=damping)
        model = spec.compile()
        model.dof_solimp[:, :2] = BRAKE_IMPEDANCE
        model.dof_solref[:, 0] = 2 * config.step
        return model

    @property
    def q(self) -> Float[np.ndarray, "joint"]:
        """Return the current joint positions [rad]."""
        return self.data.qpos.copy()

    @property
    def velocity(self) -> Float[np.ndarray, "joint"]:
        """Return the current joint velocities [rad/s]."""
        return self.data.qvel.copy()

    @property
    def torque(self) -> Float[np.ndarray, "joint"]:
        """Return the actuator torques of the last step, gravity included [Nm]."""
        return self.data.qfrc_actuator.copy()

    def step(
        self, q: Float[np.ndarray, "joint"], velocity: Float[np.ndarray, "joint"]
    ) -> None:
        """Advance one step with target positions [rad] and velocities [rad/s]."""
        self.data.ctrl[:] = q + self.feedforward * velocity
        self.mujoco.mj_step(self.model, self.data)

    def apply_wrenches(self, wrenches: Sequence[Wrench]) -> None:
        """Apply these wrenches, and no others, until the next call.

        Until then each keeps its direction and its lever arm about the centre of mass
        in the world while the link moves.
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

    def engage_brakes(self) -> None:
        """Engage the brakes."""
        self.model.dof_frictionloss[:] = self.effort

    def release_brakes(self) -> None:
        """Release the brakes."""
        self.model.dof_frictionloss[:] = 0.0
