"""This module defines the simulation environment and sites on its surfaces."""

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from jaxtyping import Bool, Float

from eskin.sim.constants import MM, Constants, load_constants
from eskin.sim.contact.chart import Chart, build_charts
from eskin.sim.contact.press import ContactSite
from eskin.sim.contact.sheet import Sheet
from eskin.sim.scene.collision import CollisionModel, build_collision_model
from eskin.sim.scene.targets import CLOSE, TouchTargets, build_targets
from eskin.skin import MountedSkin, mount_skin
from eskin.skin.surfaces import Points


@dataclass(frozen=True, eq=False)
class SimEnvironment:
    """An environment holds a robot in its skin with the data that touches need."""

    mounted: MountedSkin
    """Skin on its robot."""
    charts: tuple[Chart, ...]
    """Unrolled surfaces of the skin."""
    links: tuple[int, ...]
    """Link of each chart, as an index into the robot's links."""
    collision: CollisionModel
    """Collision model of the robot."""
    targets: TouchTargets
    """Places that a touch may aim at."""
    constants: Constants
    """Constants of the simulation."""

    def poses(
        self, q: Float[np.ndarray, "*batch joint"]
    ) -> Float[np.ndarray, "*batch link 4 4"]:
        """Return T_world_link of every link."""
        return self.mounted.kinematics.poses(q)

    @property
    def is_arm(self) -> bool:
        """Tell whether the robot stands on its base, not on its legs."""
        return self.collision.ground == 0.0

    @cached_property
    def base_height(self) -> float:
        """Return the height of the world frame's origin above the floor [m].

        An arm stands on a table by its base, a robot that is small on its lowest point;
        a tall one stands on the floor.
        """
        table = self.constants.value("robot.table")
        ground = self.collision.ground
        if self.is_arm:
            return table
        robot = self.mounted.robot
        rest = np.clip(np.zeros(len(robot.joint_names)), robot.lower, robot.upper)
        p_world, _ = self.mounted.place_taxels(rest)
        tall = p_world[:, 2].max() - ground >= self.constants.value("robot.tall")
        return -ground if tall else table - ground

    @property
    def can_move(self) -> bool:
        """Tell whether the robot has joints."""
        return len(self.mounted.robot.joint_names) > 0

    def joint_index(self, name: str) -> int:
        """Return the index of a joint in `q`.

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


def build_environment(mounted: MountedSkin, constants: Constants) -> SimEnvironment:
    """Build the environment of a robot in its skin."""
    charts = build_charts(mounted, constants.value("contact.rim"))
    links = tuple(mounted.robot.link_index(chart.link) for chart in charts)
    least = constants.value("robot.clearance") * MM
    collision = build_collision_model(mounted.robot, least)
    targets = build_targets(mounted.skin, charts, constants)
    return SimEnvironment(mounted, charts, links, collision, targets, constants)


@lru_cache(maxsize=4)
def load_environment(skin: str, robot: str | None = None) -> SimEnvironment:
    """Load the environment of a skin on its robot, cached; see `mount_skin`."""
    return build_environment(mount_skin(skin, robot), load_constants())


def compute_surface_axes(
    chart: Chart,
    centre: Float[np.ndarray, "point 2"],
    T_world_link: Float[np.ndarray, "*#batch 4 4"],
) -> tuple[Points, Points, Points, Points]:
    """Return position [m], unit axes of s and t, and outward normal in the world."""
    wrapped = chart.surface.wrap(centre)
    R = T_world_link[..., :3, :3]
    p = T_world_link[..., :3, 3]
    s_axis, normal, position = (
        np.einsum("...ij,...j->...i", R, vectors)
        for vectors in (wrapped.tangents, wrapped.normals, wrapped.positions)
    )
    position = position + p
    return position, s_axis, np.cross(normal, s_axis), normal


def compute_surface_angle(
    direction: Float[np.ndarray, "*#batch 3"],
    s_axis: Float[np.ndarray, "*#batch 3"],
    t_axis: Float[np.ndarray, "*#batch 3"],
) -> Float[np.ndarray, "*out"]:
    """Return the angle from t to a direction, counter-clockwise from outside [rad]."""
    along_s = np.sum(direction * s_axis, axis=-1)
    along_t = np.sum(direction * t_axis, axis=-1)
    return np.arctan2(-along_s, along_t)


def compute_surface_direction(
    angle: Float[np.ndarray, "*#batch"],
    s_axis: Float[np.ndarray, "*#batch 3"],
    t_axis: Float[np.ndarray, "*#batch 3"],
) -> Float[np.ndarray, "*out 3"]:
    """Return the direction at an angle from t, counter-clockwise seen from outside."""
    turned = np.asarray(angle)[..., None]
    return np.cos(turned) * t_axis - np.sin(turned) * s_axis


def build_site(
    env: SimEnvironment,
    chart: int,
    centre: Float[np.ndarray, "2"],
    direction: Float[np.ndarray, "3"],
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> ContactSite:
    """Build the site at a point of a chart, oriented along a world direction."""
    here = env.charts[chart]
    T = T_world_link[env.links[chart]]
    _, s_axis, t_axis, _ = compute_surface_axes(here, centre[None], T)
    skin_low, skin_high = find_skin_extent(env, chart, centre)
    low, high = find_free_run(env, chart, centre, T_world_link, skin_low, skin_high)
    return ContactSite(
        chart=chart,
        centre=(float(centre[0]), float(centre[1])),
        radius=here.radius,
        free_run=(max(low, skin_low), min(high, skin_high)),
        angle=float(compute_surface_angle(direction[None], s_axis, t_axis)[0]),
        beyond=(max(skin_low - low, 0.0), max(high - skin_high, 0.0)),
        can_close=not isinstance(here.surface, Sheet)
        or env.targets.allows[chart] >= CLOSE,
    )


FREE_RUN_STEP = 0.01
"""Resolution of a free run [m]."""


def find_free_run(
    env: SimEnvironment,
    chart: int,
    centre: Float[np.ndarray, "2"],
    T_world_link: Float[np.ndarray, "link 4 4"],
    skin_low: float,
    skin_high: float,
) -> tuple[float, float]:
    """Find how far a hand may slide along t with nothing above [m].

    It ends at most half a hand beyond the ends of the skin, `skin_low` and `skin_high`.
    """
    beyond = env.constants.value("place.beyond") * MM
    low, high = skin_low - beyond, skin_high + beyond
    link = env.links[chart]
    before = -np.arange(FREE_RUN_STEP, -low, FREE_RUN_STEP)
    after = np.arange(FREE_RUN_STEP, high, FREE_RUN_STEP)
    offsets = np.concatenate([before, after])
    points = centre + np.column_stack([np.zeros_like(offsets), offsets])
    position, _, _, normal = compute_surface_axes(
        env.charts[chart], points, T_world_link[link]
    )
    room = env.constants.value("place.room") * MM
    above = position + room / 2 * normal
    blocked = env.collision.compute_free_distance(T_world_link, above, link) < room / 2
    split = len(before)
    return (
        find_free_end(before, blocked[:split], low),
        find_free_end(after, blocked[split:], high),
    )


def find_free_end(
    offsets: Float[np.ndarray, "step"], blocked: Bool[np.ndarray, "step"], end: float
) -> float:
    """Return the last offset before the first blocked one, or the end if none is."""
    if not blocked.any():
        return end
    first = int(np.argmax(blocked))
    return float(offsets[first - 1]) if first else 0.0


def find_skin_extent(
    env: SimEnvironment, chart: int, centre: Float[np.ndarray, "2"]
) -> tuple[float, float]:
    """Find how far the skin extends along t from a point [m]."""
    here = env.charts[chart]
    half_width = env.constants.value("place.column") * MM
    aside = np.abs(here.wrap_s(here.unrolled[:, 0] - centre[0]))
    along = here.unrolled[aside <= half_width, 1] - centre[1]
    return float(along.min(initial=0.0)), float(along.max(initial=0.0))
