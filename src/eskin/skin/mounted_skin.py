"""This module places a skin on a robot."""

from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import SkinMismatchError
from eskin.robot import Kinematics, Robot
from eskin.skin.skin import Skin


@final
class MountedSkin:
    """A skin on a robot that has all the links it lies on.

    Attributes:
        skin: the skin.
        robot: the robot.
        kinematics: the robot's forward kinematics.
        taxel_link_index: the link of each taxel, as an index into `robot.links`.
    """

    def __init__(self, skin: Skin, robot: Robot) -> None:
        """Mount a skin.

        Raises:
            SkinMismatchError: if the robot lacks a link that the skin lies on.
        """
        lacking = sorted(set(skin.link_names) - set(robot.link_names))
        if lacking:
            raise SkinMismatchError(
                f"skin '{skin.name}' lies on links that robot '{robot.name}' does not "
                f"have: {', '.join(lacking)}; its links: "
                f"{', '.join(robot.link_names)}; mount it on the robot it was made for"
            )
        self.skin = skin
        self.robot = robot
        self.kinematics = Kinematics(robot)
        links = np.array([robot.link_index(n) for n in skin.link_names], dtype=np.int64)
        self.taxel_link_index = links[skin.patch_index]

    def place_taxels(
        self,
        q: Float[np.ndarray, "*batch joint"],
        taxels: Int[np.ndarray, "asked"] | None = None,
    ) -> tuple[
        Float[np.ndarray, "*batch asked 3"], Float[np.ndarray, "*batch asked 3"]
    ]:
        """Positions [m] and outward normals of taxels in the world.

        Args:
            q: joint values [rad] in the order of `robot.joint_names`, or a batch.
            taxels: indices of the taxels wanted; all of them where None.
        """
        asked = np.arange(self.skin.count) if taxels is None else taxels
        rotations, origins = self.get_link_poses(q, asked)
        turn = "...tij,tj->...ti"
        p_world = np.einsum(turn, rotations, self.skin.positions[asked]) + origins
        return p_world, np.einsum(turn, rotations, self.skin.normals[asked])

    def compute_frames(
        self,
        q: Float[np.ndarray, "*batch joint"],
        taxels: Int[np.ndarray, "asked"] | None = None,
    ) -> Float[np.ndarray, "*batch asked 3 3"]:
        """R_world_taxel: tangent x, tangent y and normal as columns.

        Args:
            q: joint values [rad] in the order of `robot.joint_names`, or a batch.
            taxels: indices of the taxels wanted; all of them where None.
        """
        asked = np.arange(self.skin.count) if taxels is None else taxels
        rotations, _ = self.get_link_poses(q, asked)
        x, z = self.skin.tangents[asked], self.skin.normals[asked]
        return rotations @ np.stack([x, np.cross(z, x), z], axis=-1)

    def get_link_poses(
        self, q: Float[np.ndarray, "*batch joint"], taxels: Int[np.ndarray, "asked"]
    ) -> tuple[
        Float[np.ndarray, "*batch asked 3 3"], Float[np.ndarray, "*batch asked 3"]
    ]:
        """Rotation and origin [m] in the world of the link of each taxel asked."""
        T_world_link = self.kinematics.poses(q)[
            ..., self.taxel_link_index[taxels], :, :
        ]
        return T_world_link[..., :3, :3], T_world_link[..., :3, 3]
