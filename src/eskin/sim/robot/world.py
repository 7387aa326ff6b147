"""What stays the same for all touches: the robot in its skin, and every number."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import Constants
from eskin.sim.contact.chart import Chart, charts_of
from eskin.sim.robot.clearance import Solids, solids_of
from eskin.sim.site.spots import Spots, spots_of
from eskin.skin import MountedSkin


@dataclass(frozen=True, eq=False)
class World:
    """A robot in its skin, prepared for touching."""

    mounted: MountedSkin
    """The skin on its robot."""
    charts: tuple[Chart, ...]
    """The skin's surfaces, unrolled."""
    links: tuple[int, ...]
    """The link of each chart, as an index into the robot's links."""
    solids: Solids
    """What may collide."""
    spots: Spots
    """Places that can be touched."""
    constants: Constants
    """Numbers of the world."""

    def poses(
        self, q: Float[np.ndarray, "*batch joint"]
    ) -> Float[np.ndarray, "*batch link 4 4"]:
        """T_world_link of every link."""
        return self.mounted.kinematics.poses(q)

    @property
    def can_move(self) -> bool:
        """Whether the robot has joints."""
        return len(self.mounted.robot.joint_names) > 0

    def joint(self, name: str) -> int:
        """Place of a joint in `q`.

        Raises:
            ValueError: the robot has no such joint.
        """
        names = self.mounted.robot.joint_names
        if name not in names:
            raise ValueError(
                f"robot '{self.mounted.robot.name}' has no joint '{name}'; poses are "
                f"drawn of arms like the UR5; its joints: {', '.join(names)}"
            )
        return names.index(name)


def build_world(mounted: MountedSkin, constants: Constants) -> World:
    """Prepare a robot in its skin for touching."""
    charts = charts_of(mounted, constants.value("contact.rim"))
    links = tuple(mounted.robot.link_index(chart.link) for chart in charts)
    solids = solids_of(mounted.robot)
    spots = spots_of(mounted.skin, charts, constants)
    return World(mounted, charts, links, solids, spots, constants)
