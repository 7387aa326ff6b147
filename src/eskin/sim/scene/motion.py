"""This module draws motions of the robot, and moves presses relative to its links."""

from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from jaxtyping import Float

from eskin.sim.contact.chart import Chart
from eskin.sim.contact.press import AnyPress, Press
from eskin.sim.scene.environment import (
    SimEnvironment,
    compute_surface_angle,
    compute_surface_axes,
    compute_surface_direction,
)
from eskin.sim.scene.folds import sample_patches
from eskin.sim.scene.poses import POSE_GROUPS, draw_pose
from eskin.sim.scene.validity import are_collision_free
from eskin.transforms import apply, invert, make_transform


@dataclass(frozen=True)
class SpeedProfile:
    """A speed profile describes a move from rest to rest at trapezoidal speed."""

    length: float
    """Length of the whole move [rad]."""
    speed: float
    """Greatest speed [rad/s]."""
    acceleration: float
    """Acceleration at both ends [rad/s2]."""

    @property
    def ramp(self) -> float:
        """Return the time to reach full speed [s]."""
        return self.speed / self.acceleration

    @property
    def duration(self) -> float:
        """Return the time from rest to rest [s]."""
        return self.length / self.speed + self.ramp

    def at(self, time: Float[np.ndarray, "time"]) -> Float[np.ndarray, "time"]:
        """Return the distance covered since the start [rad]."""
        t = np.clip(time, 0.0, self.duration)
        left = self.duration - t
        rising = self.acceleration * t**2 / 2
        falling = self.length - self.acceleration * left**2 / 2
        cruising = self.speed * (t - self.ramp / 2)
        slow = np.where(t < self.duration / 2, rising, falling)
        return np.where(np.minimum(t, left) < self.ramp, slow, cruising)


def build_speed_profile(
    length: float, speed: float, acceleration: float
) -> SpeedProfile:
    """Build the fastest move over a length [rad] within two limits."""
    reached = min(speed, float(np.sqrt(length * acceleration)))
    return SpeedProfile(length, reached, acceleration)


def follow_with_delay(
    press: AnyPress,
    env: SimEnvironment,
    q_series: Float[np.ndarray, "time joint"],
    delay: float,
) -> AnyPress:
    """Return a press by a hand that follows the moving robot with a delay.

    At each instant the hand is where its target was a delay ago, but never earlier than
    at its landing: it lands on the target and slides until it has caught up. `press` is
    that on a robot at rest, `q_series` the poses at the steps of the scene [rad], and
    `delay` is in [s]. A body with an anchor does not follow: the robot slides past it.
    """
    if np.all(q_series == q_series[0]):
        return press
    now = press.first + np.arange(press.steps, dtype=np.float64)
    q_now = interpolate_poses(q_series, now)
    if isinstance(press, Press) and press.anchor is not None:
        q_landing_twice = np.concatenate([q_now[:1], q_now])
        slid, _ = slide_past_body(press, env, q_landing_twice, None)
        return cast(AnyPress, slid)
    then = np.maximum(now - delay / env.constants.value("time.step"), now[0])
    return move_press_on_link(press, env, q_now, interpolate_poses(q_series, then))


def move_press_on_link(
    press: AnyPress,
    env: SimEnvironment,
    q_now: Float[np.ndarray, "step joint"],
    q_then: Float[np.ndarray, "step joint"],
) -> AnyPress:
    """Return a press with its hand at `q_now` where its target was at `q_then`."""
    link = env.links[press.chart]
    chart = env.charts[press.chart]
    T_now = env.poses(q_now)[:, link]
    T_then = env.poses(q_then)[:, link]
    p_then, s_then, t_then, _ = compute_surface_axes(chart, press.centre, T_then)
    p_now, s_now, t_now, _ = compute_surface_axes(chart, press.centre, T_now)
    # Only the displacement in the tangent plane counts, so hands never enter a tube.
    slid = [np.sum((p_then - p_now) * axis, axis=1) for axis in (s_now, t_now)]
    direction = compute_surface_direction(press.angle, s_then, t_then)
    turn = compute_surface_angle(direction, s_now, t_now) - press.angle
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    centre = press.centre + np.column_stack(slid)
    return replace(press, centre=centre, angle=press.angle + turn)


def drag_past(
    chart: Chart,
    p_world: Float[np.ndarray, "3"],
    T_world_link: Float[np.ndarray, "time 4 4"],
    dragged: float = 0.0,
    deepest: float = np.inf,
) -> tuple[
    Float[np.ndarray, "time 2"], Float[np.ndarray, "time"], Float[np.ndarray, "3"]
]:
    """Return how a surface that moves passes a point that stands in the world.

    Args:
        chart: chart of the surface.
        p_world: point in the world at the first step [m].
        T_world_link: pose of the link of the chart at each step.
        dragged: share of the motion of the surface along itself that the point follows.
        deepest: depth below the surface from which it is pushed ahead [m].

    Returns:
        The place of the surface that is next to the point, unrolled (s, t) [m]; the
        height of the point above it along the outward normal, negative inside [m]; and
        the point in the world at the last step [m].
    """
    path = np.zeros((len(T_world_link), 2))
    height = np.zeros(len(T_world_link))
    p_link = apply(invert(T_world_link[0]), p_world)
    for step, T in enumerate(T_world_link):
        carried = p_link
        p_link = apply(invert(T), p_world)
        path[step] = chart.surface.unroll(p_link[None])[0]
        found = chart.surface.wrap(path[step][None])
        normal = found.normals[0]
        slid = p_link - carried
        slid = slid - (slid @ normal) * normal
        depth = (found.positions[0] - p_link) @ normal
        pushed = max(depth - deepest, 0.0)
        height[step] = pushed - depth
        p_link = p_link - dragged * slid + pushed * normal
        p_world = apply(T, p_link)
    return path, height, p_world


def slide_past_body(
    press: Press,
    env: SimEnvironment,
    q_series: Float[np.ndarray, "step_and_one joint"],
    T_world_body: Float[np.ndarray, "4 4"] | None,
) -> tuple[Press, Float[np.ndarray, "4 4"]]:
    """Return the press of a body that stands, on a robot that slides past it.

    The force grows evenly with the depth from zero at the give of the anchor, and is
    zero where the body is off the surface.

    Args:
        press: press on a robot at rest.
        env: robot in its skin.
        q_series: joint positions at the step before those of the press, then at them;
            the landing comes twice [rad].
        T_world_body: pose of the body before the press; None at its landing, where its
            axes are s, t and the normal of the surface.

    Returns:
        The press, and the pose of the body at its end.
    """
    anchor = press.anchor
    assert anchor is not None
    link = env.links[press.chart]
    chart = env.charts[press.chart]
    T = env.poses(q_series)[:, link]
    site = np.array([anchor.centre])
    p_landed, *axes = (each[0] for each in compute_surface_axes(chart, site, T[:1]))
    if T_world_body is None:
        T_world_body = make_transform(np.column_stack(axes), p_landed)
    R = T_world_body[:3, :3]
    p_world = T_world_body[:3, 3]
    deepest = min((anchor.most - 1.0) * anchor.give, chart.radius / 2)
    path, height, p_world = drag_past(chart, p_world, T, anchor.dragged, deepest)
    # The unrolling of a sheet is not exact, so its error at the landing is taken off.
    first, above, _ = drag_past(chart, p_landed, T[:1])
    slid = path[1:] - first
    slid[:, 0] = chart.wrap_s(slid[:, 0])
    gap = height[1:] - above
    centre = press.centre + slid
    _, s_axis, t_axis, _ = compute_surface_axes(chart, site + slid, T[1:])
    direction = compute_surface_direction(press.angle, R[:, 0], R[:, 1])
    turn = compute_surface_angle(direction, s_axis, t_axis) - press.angle
    turn = (turn + np.pi) % (2 * np.pi) - np.pi
    way = np.linalg.norm(slid, axis=1)
    ripple = 1.0 + anchor.ripple * np.sin(2 * np.pi * way / anchor.ripple_length)
    share = np.clip(1.0 - gap / anchor.give, 0.0, anchor.most)
    low, high = anchor.run
    off = (slid[:, 1] < low) | (slid[:, 1] > high) | chart.is_beyond(centre)
    force = np.where(off, 0.0, press.force * share * ripple)
    moved = replace(press, force=force, centre=centre, angle=press.angle + turn)
    return moved, make_transform(R, p_world)


def interpolate_poses(
    q_series: Float[np.ndarray, "time joint"], steps: Float[np.ndarray, "step"]
) -> Float[np.ndarray, "step joint"]:
    """Interpolate poses between steps, and extrapolate before the first."""
    last = len(q_series) - 1
    if last == 0:
        return np.tile(q_series[0], (len(steps), 1))
    low = np.clip(np.floor(steps).astype(np.int64), 0, last - 1)
    share = np.minimum(steps, last) - low
    return q_series[low] + share[:, None] * (q_series[low + 1] - q_series[low])


def hold_pose(
    env: SimEnvironment, q: Float[np.ndarray, "joint"], seconds: float
) -> Float[np.ndarray, "time joint"]:
    """Return the series of a robot at rest [rad]."""
    return np.tile(q, (count_steps(env, seconds), 1))


def count_steps(env: SimEnvironment, seconds: float) -> int:
    """Return the number of simulator steps in a duration [s], at least one."""
    return max(1, round(seconds / env.constants.value("time.step")))


def draw_motion(
    env: SimEnvironment,
    q: Float[np.ndarray, "joint"],
    seconds: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "time joint"]:
    """Draw a motion of the robot that takes a pose in the middle of the time [rad].

    Some joints start together, reach their speeds, and stop together; the move may
    begin before the series and end after it. If every attempt would collide, only the
    base turns.
    """
    for _ in range(int(env.constants.value("motion.tries"))):
        series = move_through_pose(env, q, draw_joint_direction(env, rng), seconds, rng)
        if is_path_free(env, series):
            return series
    base = np.zeros(len(q))
    base[0] = rng.choice([-1.0, 1.0])
    return move_through_pose(env, q, base, seconds, rng)


def draw_joint_direction(
    env: SimEnvironment, rng: np.random.Generator
) -> Float[np.ndarray, "joint"]:
    """Draw the speeds of all joints, relative to the fastest one."""
    count = int(env.constants.choose("motion.joints", rng))
    joints = len(env.mounted.robot.joint_names)
    moving = rng.choice(joints, size=min(count, joints), replace=False)
    direction = np.zeros(joints)
    direction[moving] = rng.uniform(-1.0, 1.0, len(moving))
    return direction / np.abs(direction).max()


def move_through_pose(
    env: SimEnvironment,
    q: Float[np.ndarray, "joint"],
    direction: Float[np.ndarray, "joint"],
    seconds: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "time joint"]:
    """Draw a move along a direction that takes a pose in the middle of the time."""
    draw = env.constants.draw
    speed = min(draw("motion.speed", rng), compute_max_speed(env, q[None], direction))
    acceleration = draw("motion.acceleration", rng)
    cruise = seconds * draw("motion.cruise", rng)
    move = SpeedProfile(speed * (cruise + speed / acceleration), speed, acceleration)
    middle = rng.uniform(0.0, move.duration)
    step = env.constants.value("time.step")
    time = step * np.arange(count_steps(env, seconds))
    time = time - time[len(time) // 2] + middle
    travelled = move.at(time) - move.at(np.array([middle]))
    return q + travelled[:, None] * direction


def compute_max_speed(
    env: SimEnvironment,
    q: Float[np.ndarray, "pose joint"],
    direction: Float[np.ndarray, "joint"],
) -> float:
    """Return the greatest speed at which no skin exceeds `motion.fastest` [rad/s]."""
    epsilon = 1e-6
    samples = sample_patches(env)
    links = np.repeat(samples.links, np.diff(samples.starts))

    def compute_positions(q: Float[np.ndarray, "pose joint"]) -> np.ndarray:
        T = env.poses(q)[:, links]
        return np.einsum("ptij,tj->pti", T[..., :3, :3], samples.points) + T[..., :3, 3]

    moved = compute_positions(q + epsilon * direction) - compute_positions(q)
    fastest = float(np.linalg.norm(moved, axis=-1).max()) / epsilon
    return env.constants.value("motion.fastest") / max(fastest, 1e-3)


def is_path_free(env: SimEnvironment, series: Float[np.ndarray, "time joint"]) -> bool:
    """Tell whether a series of poses is within joint limits and free of collisions."""
    robot = env.mounted.robot
    if np.any(series < robot.lower) or np.any(series > robot.upper):
        return False
    every = count_steps(env, env.constants.value("motion.check"))
    checked = np.concatenate([series[::every], series[-1:]])
    return bool(are_collision_free(env, env.poses(checked)).all())


def draw_pose_path(
    env: SimEnvironment,
    seconds: float,
    rng: np.random.Generator,
    groups: frozenset[int] = POSE_GROUPS,
) -> Float[np.ndarray, "time joint"]:
    """Draw a motion from pose to pose, with pauses, for a stream [rad].

    It pauses in poses of `groups`.
    """
    at = draw_pose(env, groups, rng)
    parts = []
    length = 0
    wanted = count_steps(env, seconds)
    while length < wanted:
        pause = hold_pose(env, at, env.constants.draw("motion.pause", rng))
        move = draw_next_move(env, at, groups, rng)
        parts += [pause, move]
        length += len(pause) + len(move)
        at = move[-1]
    return np.concatenate(parts)[:wanted]


def draw_next_move(
    env: SimEnvironment,
    start: Float[np.ndarray, "joint"],
    groups: frozenset[int],
    rng: np.random.Generator,
) -> Float[np.ndarray, "time joint"]:
    """Draw a move to another pose, or a turn of the base if all would collide."""
    for _ in range(int(env.constants.value("motion.tries"))):
        move = draw_straight_move(env, start, draw_pose(env, groups, rng), rng)
        if is_path_free(env, move):
            return move
    end = start.copy()
    end[0] = draw_pose(env, groups, rng)[0]
    return draw_straight_move(env, start, end, rng)


def draw_straight_move(
    env: SimEnvironment,
    start: Float[np.ndarray, "joint"],
    end: Float[np.ndarray, "joint"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "time joint"]:
    """Draw a move from one pose to another, with all joints in proportion."""
    length = float(np.abs(end - start).max())
    direction = (end - start) / length
    between = start + np.linspace(0.0, 1.0, 9)[:, None] * (end - start)
    draw = env.constants.draw
    speed = min(draw("motion.speed", rng), compute_max_speed(env, between, direction))
    move = build_speed_profile(length, speed, draw("motion.acceleration", rng))
    step = env.constants.value("time.step")
    time = step * np.arange(1, int(np.ceil(move.duration / step)) + 1)
    return start + move.at(time)[:, None] * direction
