"""Where the robot's links are right now, computed once for all who ask."""

from typing import final

import numpy as np
from jaxtyping import Float

from eskin.errors import ReadingError
from eskin.skin.mount import MountedSkin


@final
class LivePoses:
    """Poses of the links at the latest q asked for; an arm at rest costs nothing."""

    def __init__(self, mounted: MountedSkin, posed: bool = True) -> None:
        """Start without a pose.

        Args:
            mounted: the skin on its robot.
            posed: whether q counts; else every joint is at 0, whatever is asked.
        """
        self.mounted = mounted
        self.posed = posed
        self.joints = len(mounted.robot.joint_names)
        self.q: bytes | None = None
        self.T_world_link = np.empty((0, 4, 4))

    def at(self, q: Float[np.ndarray, "joint"]) -> Float[np.ndarray, "link 4 4"]:
        """T_world_link of all links in the robot's order."""
        asked = q.tobytes()
        if asked != self.q:
            self.check(q)
            seen = q if self.posed else np.zeros_like(q)
            self.T_world_link = self.mounted.kinematics.poses(seen)
            self.q = asked
        return self.T_world_link

    def check(self, q: Float[np.ndarray, "joint"]) -> None:
        """Refuse the joint positions of another robot."""
        if len(q) != self.joints:
            raise ReadingError(
                f"q has {len(q)} joints, robot '{self.mounted.robot.name}' has "
                f"{self.joints}; allowed is one number a moving joint; "
                "use the robot that the data came from"
            )
