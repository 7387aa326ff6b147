"""This module computes where the taxels of a skin are on a robot, for a given q."""

from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import SkinMismatchError
from eskin.robot import Kinematics, Robot
from eskin.skin.skin import Skin


@final
class MountedSkin:
    """A mounted skin combines a skin with a robot that has all its links.

    Attributes:
        skin: the skin.
        robot: the robot.
        kinematics: forward kinematics of the robot.
        taxel_link_index: index of each taxel's link in `robot.links`.
    """

    def __init__(self, skin: Skin, robot: Robot) -> None:
        """Mount a skin on a robot.

        Raises:
            SkinMismatchError: The robot lacks a link that the skin lies on.
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
        taxels: Int[np.ndarray, "selected"] | None = None,
    ) -> tuple[
        Float[np.ndarray, "*batch selected 3"], Float[np.ndarray, "*batch selected 3"]
    ]:
        """Return positions [m] and outward normals of taxels in the world.

        Args:
            q: joint values [rad] in the order of `robot.joint_names`, or a batch.
            taxels: indices of the taxels; None for all of them.
        """
        selected = np.arange(self.skin.count) if taxels is None else taxels
        rotations, origins = self.get_link_poses(q, selected)
        turn = "...tij,tj->...ti"
        p_world = np.einsum(turn, rotations, self.skin.positions[selected]) + origins
        return p_world, np.einsum(turn, rotations, self.skin.normals[selected])

    def compute_frames(
        self,
        q: Float[np.ndarray, "*batch joint"],
        taxels: Int[np.ndarray, "selected"] | None = None,
    ) -> Float[np.ndarray, "*batch selected 3 3"]:
        """Return R_world_taxel, with tangent x, tangent y and normal as columns.

        Args:
            q: joint values [rad] in the order of `robot.joint_names`, or a batch.
            taxels: indices of the taxels; None for all of them.
        """
        selected = np.arange(self.skin.count) if taxels is None else taxels
        rotations, _ = self.get_link_poses(q, selected)
        x, z = self.skin.tangents[selected], self.skin.normals[selected]
        return rotations @ np.stack([x, np.cross(z, x), z], axis=-1)

    def get_link_poses(
        self, q: Float[np.ndarray, "*batch joint"], taxels: Int[np.ndarray, "selected"]
    ) -> tuple[
        Float[np.ndarray, "*batch selected 3 3"], Float[np.ndarray, "*batch selected 3"]
    ]:
        """Return rotation and origin [m] in the world of each selected taxel's link."""
        T_world_link = self.kinematics.poses(q)[
            ..., self.taxel_link_index[taxels], :, :
        ]
        return T_world_link[..., :3, :3], T_world_link[..., :3, 3]
