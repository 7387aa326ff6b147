"""This module moves the robot, and presses that follow it late or hang still."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from eskin.sim.contact.press import Press
from eskin.sim.scene.environment import (
    SimEnvironment,
    compute_surface_angle,
    compute_surface_axes,
    compute_surface_direction,
)
from eskin.sim.scene.folds import sample_patches
from eskin.sim.scene.poses import POSE_GROUPS, draw_pose
from eskin.sim.scene.validity import are_collision_free


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
        """Return the distance since the start [rad]; at rest before and after."""
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
    """Build the fastest move over a length [rad] within a speed and an acceleration."""
    reached = min(speed, float(np.sqrt(length * acceleration)))
    return SpeedProfile(length, reached, acceleration)


def follow_late(
    press: Press,
    env: SimEnvironment,
    q_series: Float[np.ndarray, "time joint"],
    delay: float,
) -> Press:
    """Return a press by a hand that follows the moving robot with a delay.

    At each instant the hand is where its target was a delay ago, but never earlier than
    when it touched: it lands on the target, and slides until it has caught up.

    Args:
        press: press on a robot at rest.
        env: robot in its skin.
        q_series: poses at the steps of the scene's clock [rad].
        delay: delay of the hand [s].
    """
    now = press.first + np.arange(press.steps, dtype=np.float64)
    late = now - delay / env.constants.value("time.step")
    return carry_press(press, env, q_series, now, np.maximum(late, now[0]))


def hang_still(
    press: Press, env: SimEnvironment, q_series: Float[np.ndarray, "time joint"]
) -> Press:
    """Return a press by what hangs still, such as a cable, while a link moves.

    Args:
        press: press on a robot at rest.
        env: robot in its skin.
        q_series: poses at the steps of the scene's clock [rad].
    """
    now = press.first + np.arange(press.steps, dtype=np.float64)
    return carry_press(press, env, q_series, now, np.full_like(now, now[0]))


def carry_press(
    press: Press,
    env: SimEnvironment,
    q_series: Float[np.ndarray, "time joint"],
    now: Float[np.ndarray, "step"],
    then: Float[np.ndarray, "step"],
) -> Press:
    """Return the press with its hand at steps `now` where it was at steps `then`."""
    if np.all(q_series == q_series[0]):
        return press
    return move_press_on_link(
        press,
        env,
        interpolate_poses(q_series, now),
        interpolate_poses(q_series, then),
    )


def move_press_on_link(
    press: Press,
    env: SimEnvironment,
    q_now: Float[np.ndarray, "step joint"],
    q_then: Float[np.ndarray, "step joint"],
) -> Press:
    """Return the press where T_link(now)^-1 T_link(then) takes its target and angle."""
    link, chart = env.links[press.chart], env.charts[press.chart]
    T_now, T_then = env.poses(q_now)[:, link], env.poses(q_then)[:, link]
    was, s_then, t_then, _ = compute_surface_axes(chart, press.centre, T_then)
    here, s_now, t_now, _ = compute_surface_axes(chart, press.centre, T_now)
    # The way is flat at the target: a hand leaves a tube, it does not enter it.
    slid = [np.sum((was - here) * axis, axis=1) for axis in (s_now, t_now)]
    turned = compute_surface_angle(
        compute_surface_direction(press.angle, s_then, t_then), s_now, t_now
    )
    turn = (turned - press.angle + np.pi) % (2 * np.pi) - np.pi
    return replace(
        press,
        centre=press.centre + np.column_stack(slid),
        angle=press.angle + turn,
    )


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


Direction = Float[np.ndarray, "joint"]


def hold_pose(
    env: SimEnvironment, q: Float[np.ndarray, "joint"], seconds: float
) -> Float[np.ndarray, "time joint"]:
    """Return the series of a robot that stays where it is [rad]."""
    return np.tile(q, (count_steps(env, seconds), 1))


def count_steps(env: SimEnvironment, seconds: float) -> int:
    """Return the steps of the simulator's clock in a time [s]."""
    return max(1, round(seconds / env.constants.value("time.step")))


def draw_motion(
    env: SimEnvironment,
    q: Float[np.ndarray, "joint"],
    seconds: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "time joint"]:
    """Draw a robot that moves through a pose, which it takes in the middle of the time.

    Some joints start together, reach their speeds, and stop together; the move may have
    begun before and go on after. Where all that is tried would collide, the base turns
    alone.

    Args:
        env: robot in its skin.
        q: pose [rad].
        seconds: duration [s].
        rng: random generator.
    """
    for _ in range(int(env.constants.value("motion.tries"))):
        series = move_through_pose(env, q, draw_joint_direction(env, rng), seconds, rng)
        if is_path_free(env, series):
            return series
    base = np.zeros(len(q))
    base[0] = rng.choice([-1.0, 1.0])
    return move_through_pose(env, q, base, seconds, rng)


def draw_joint_direction(env: SimEnvironment, rng: np.random.Generator) -> Direction:
    """Draw the speeds of the joints relative to the fastest."""
    count = int(env.constants.choose("motion.joints", rng))
    joints = len(env.mounted.robot.joint_names)
    moving = rng.choice(joints, size=min(count, joints), replace=False)
    direction = np.zeros(joints)
    direction[moving] = rng.uniform(-1.0, 1.0, len(moving))
    return direction / np.abs(direction).max()


def move_through_pose(
    env: SimEnvironment,
    q: Float[np.ndarray, "joint"],
    direction: Direction,
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
    env: SimEnvironment, q: Float[np.ndarray, "pose joint"], direction: Direction
) -> float:
    """Return the greatest speed at which no skin moves too fast [rad/s]."""
    nudge = 1e-6
    samples = sample_patches(env)
    links = np.repeat(samples.links, np.diff(samples.starts))

    def places(at: Float[np.ndarray, "pose joint"]) -> np.ndarray:
        T = env.poses(at)[:, links]
        return np.einsum("ptij,tj->pti", T[..., :3, :3], samples.points) + T[..., :3, 3]

    moved = places(q + nudge * direction) - places(q)
    most = float(np.linalg.norm(moved, axis=-1).max()) / nudge
    return env.constants.value("motion.fastest") / max(most, 1e-3)


def is_path_free(env: SimEnvironment, series: Float[np.ndarray, "time joint"]) -> bool:
    """Tell whether a series of poses stays within limits and clear of everything."""
    robot = env.mounted.robot
    if np.any(series < robot.lower) or np.any(series > robot.upper):
        return False
    every = count_steps(env, env.constants.value("motion.check"))
    looked_at = np.concatenate([series[::every], series[-1:]])
    return bool(are_collision_free(env, env.poses(looked_at)).all())


def draw_pose_path(
    env: SimEnvironment,
    seconds: float,
    rng: np.random.Generator,
    groups: frozenset[int] = POSE_GROUPS,
) -> Float[np.ndarray, "time joint"]:
    """Draw a robot that goes from pose to pose, with pauses, for a stream [rad].

    Args:
        env: robot in its skin.
        seconds: duration [s].
        rng: random generator.
        groups: groups of the poses that it pauses at.
    """
    at = draw_pose(env, groups, rng)
    parts, length, wanted = [], 0, count_steps(env, seconds)
    while length < wanted:
        pause = hold_pose(env, at, env.constants.draw("motion.pause", rng))
        leg = draw_leg(env, at, groups, rng)
        parts += [pause, leg]
        length += len(pause) + len(leg)
        at = leg[-1]
    return np.concatenate(parts)[:wanted]


def draw_leg(
    env: SimEnvironment,
    start: Float[np.ndarray, "joint"],
    groups: frozenset[int],
    rng: np.random.Generator,
) -> Float[np.ndarray, "time joint"]:
    """Draw a move to another pose, or a turn of the base where none can be reached."""
    for _ in range(int(env.constants.value("motion.tries"))):
        leg = draw_straight_move(env, start, draw_pose(env, groups, rng), rng)
        if is_path_free(env, leg):
            return leg
    end = start.copy()
    end[0] = draw_pose(env, groups, rng)[0]
    return draw_straight_move(env, start, end, rng)


def draw_straight_move(
    env: SimEnvironment,
    start: Float[np.ndarray, "joint"],
    end: Float[np.ndarray, "joint"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "time joint"]:
    """Draw a move from one pose to another, all joints together."""
    length = float(np.abs(end - start).max())
    direction = (end - start) / length
    between = start + np.linspace(0.0, 1.0, 9)[:, None] * (end - start)
    draw = env.constants.draw
    speed = min(draw("motion.speed", rng), compute_max_speed(env, between, direction))
    move = build_speed_profile(length, speed, draw("motion.acceleration", rng))
    step = env.constants.value("time.step")
    time = step * np.arange(1, int(np.ceil(move.duration / step)) + 1)
    return start + move.at(time)[:, None] * direction
