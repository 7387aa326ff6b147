"""The environment holds the robot in its skin, prepared for touching."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Float

from eskin.robot import load_robot
from eskin.sim.constants import MM, Constants, load_constants
from eskin.sim.contact.chart import Chart, build_charts
from eskin.sim.contact.press import ContactSite
from eskin.sim.scene.collision import CollisionModel, build_collision_model
from eskin.sim.scene.targets import TouchTargets, build_targets
from eskin.skin import SKIN_PRESETS, MountedSkin


@dataclass(frozen=True, eq=False)
class SimEnvironment:
    """An environment holds a robot in its skin with all that touches need."""

    mounted: MountedSkin
    """Skin on its robot."""
    charts: tuple[Chart, ...]
    """Unrolled surfaces of the skin."""
    links: tuple[int, ...]
    """Link of each chart, as an index into the robot's links."""
    collision: CollisionModel
    """Collision model of the robot."""
    targets: TouchTargets
    """Places that can be touched."""
    constants: Constants
    """Constants of the simulation."""

    def poses(
        self, q: Float[np.ndarray, "*batch joint"]
    ) -> Float[np.ndarray, "*batch link 4 4"]:
        """Return T_world_link of every link."""
        return self.mounted.kinematics.poses(q)

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
    collision = build_collision_model(mounted.robot)
    spots = build_targets(mounted.skin, charts, constants)
    return SimEnvironment(mounted, charts, links, collision, spots, constants)


def mount_preset(skin: str) -> MountedSkin:
    """Mount a preset skin on its robot."""
    preset = SKIN_PRESETS[skin]
    return MountedSkin(preset.build(), load_robot(preset.robot))


@lru_cache(maxsize=4)
def load_environment(skin: str) -> SimEnvironment:
    """Load a preset skin on its robot, prepared for touching, cached."""
    return build_environment(mount_preset(skin), load_constants())


def compute_surface_axes(
    chart: Chart,
    centre: Float[np.ndarray, "point 2"],
    T_world_link: Float[np.ndarray, "*#batch 4 4"],
) -> tuple[
    Float[np.ndarray, "point 3"],
    Float[np.ndarray, "point 3"],
    Float[np.ndarray, "point 3"],
    Float[np.ndarray, "point 3"],
]:
    """Return position [m], directions of s and t, and outward normal in the world."""
    wrapped = chart.surface.wrap(centre)
    R, p = T_world_link[..., :3, :3], T_world_link[..., :3, 3]
    turn = "...ij,...j->...i"
    s_axis = np.einsum(turn, R, wrapped.tangents)
    normal = np.einsum(turn, R, wrapped.normals)
    position = np.einsum(turn, R, wrapped.positions) + p
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
    """Build the site at a point of a chart, turned to a direction of the world."""
    here = env.charts[chart]
    T = T_world_link[env.links[chart]]
    _, s_axis, t_axis, _ = compute_surface_axes(here, centre[None], T)
    return ContactSite(
        chart=chart,
        centre=(float(centre[0]), float(centre[1])),
        radius=here.radius,
        free_run=find_free_run(env, chart, centre, T_world_link),
        angle=float(compute_surface_angle(direction[None], s_axis, t_axis)[0]),
    )


STRIDE = 0.01
"""Step along a free run [m]."""


def find_free_run(
    env: SimEnvironment,
    chart: int,
    centre: Float[np.ndarray, "2"],
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> tuple[float, float]:
    """Find how far a hand may slide along t: skin below, nothing above [m]."""
    low, high = find_skin_extent(env, chart, centre)
    here, link = env.charts[chart], env.links[chart]
    before = -np.arange(STRIDE, -low, STRIDE)
    after = np.arange(STRIDE, high, STRIDE)
    steps = np.concatenate([before, after])
    at = centre + np.column_stack([np.zeros_like(steps), steps])
    T = T_world_link[link]
    position, _, _, normal = compute_surface_axes(here, at, T)
    room = env.constants.value("place.room") * MM
    over = position + room / 2 * normal
    blocked = env.collision.compute_free_distance(T_world_link, over, link) < room / 2
    return (
        low
        if not blocked[: len(before)].any()
        else find_last_free_step(before, blocked),
        high
        if not blocked[len(before) :].any()
        else find_last_free_step(after, blocked[-len(after) :]),
    )


def find_last_free_step(steps: Float[np.ndarray, "step"], blocked: np.ndarray) -> float:
    """Return the last step before the first that is blocked [m]."""
    first = int(np.argmax(blocked[: len(steps)]))
    return float(steps[first - 1]) if first else 0.0


def find_skin_extent(
    env: SimEnvironment, chart: int, centre: Float[np.ndarray, "2"]
) -> tuple[float, float]:
    """Find how far skin goes on along t from a point [m]."""
    here = env.charts[chart]
    lane = env.constants.value("place.column") * MM
    aside = np.abs(here.wrap_s(here.unrolled[:, 0] - centre[0]))
    along = here.unrolled[aside <= lane, 1] - centre[1]
    return float(along.min(initial=0.0)), float(along.max(initial=0.0))
