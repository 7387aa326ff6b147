"""How the robot moves while it is touched."""

import numpy as np
from jaxtyping import Float

from eskin.sim.robot.free import is_free
from eskin.sim.robot.groups import GROUPS
from eskin.sim.robot.lag import drag, follow
from eskin.sim.robot.pose import draw_pose
from eskin.sim.robot.profile import Profile, profile_of
from eskin.sim.robot.world import World
from eskin.sim.site.folding import faces_of

__all__ = ["drag", "draw_motion", "follow", "still", "way"]

Direction = Float[np.ndarray, "joint"]


def still(
    world: World, q: Float[np.ndarray, "joint"], seconds: float
) -> Float[np.ndarray, "time joint"]:
    """A robot that stays where it is [rad]."""
    return np.tile(q, (steps_in(world, seconds), 1))


def steps_in(world: World, seconds: float) -> int:
    """Steps of the simulator's clock in a time [s]."""
    return max(1, round(seconds / world.constants.value("time.step")))


def draw_motion(
    world: World,
    q: Float[np.ndarray, "joint"],
    seconds: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "time joint"]:
    """A robot that moves through a pose, which it takes in the middle of the time.

    Some joints start together, reach their speeds, and stop together; it may have
    begun before and go on after. Where all that is tried would collide, the base turns
    alone.

    Args:
        world: the robot.
        q: the pose [rad].
        seconds: how long.
        rng: to draw from.
    """
    for _ in range(int(world.constants.value("motion.tries"))):
        series = through(world, q, draw_direction(world, rng), seconds, rng)
        if keeps_free(world, series):
            return series
    base = np.zeros(len(q))
    base[0] = rng.choice([-1.0, 1.0])
    return through(world, q, base, seconds, rng)


def draw_direction(world: World, rng: np.random.Generator) -> Direction:
    """Speeds of the joints by that of the fastest."""
    count = int(world.constants.choose("motion.joints", rng))
    joints = len(world.mounted.robot.joint_names)
    moving = rng.choice(joints, size=min(count, joints), replace=False)
    direction = np.zeros(joints)
    direction[moving] = rng.uniform(-1.0, 1.0, len(moving))
    return direction / np.abs(direction).max()


def through(
    world: World,
    q: Float[np.ndarray, "joint"],
    direction: Direction,
    seconds: float,
    rng: np.random.Generator,
) -> Float[np.ndarray, "time joint"]:
    """A move along a direction that takes a pose in the middle of the time."""
    draw = world.constants.draw
    speed = min(draw("motion.speed", rng), fastest(world, q[None], direction))
    acceleration = draw("motion.acceleration", rng)
    cruise = seconds * draw("motion.cruise", rng)
    move = Profile(speed * (cruise + speed / acceleration), speed, acceleration)
    middle = rng.uniform(0.0, move.duration)
    step = world.constants.value("time.step")
    time = step * np.arange(steps_in(world, seconds))
    time = time - time[len(time) // 2] + middle
    travelled = move.at(time) - move.at(np.array([middle]))
    return q + travelled[:, None] * direction


def fastest(
    world: World, q: Float[np.ndarray, "pose joint"], direction: Direction
) -> float:
    """Greatest speed along a direction at which no skin is too fast [rad/s]."""
    nudge = 1e-6
    faces = faces_of(world)
    links = np.repeat(faces.links, np.diff(faces.starts))

    def places(at: Float[np.ndarray, "pose joint"]) -> np.ndarray:
        T = world.poses(at)[:, links]
        return np.einsum("ptij,tj->pti", T[..., :3, :3], faces.points) + T[..., :3, 3]

    moved = places(q + nudge * direction) - places(q)
    most = float(np.linalg.norm(moved, axis=-1).max()) / nudge
    return world.constants.value("motion.fastest") / max(most, 1e-3)


def keeps_free(world: World, series: Float[np.ndarray, "time joint"]) -> bool:
    """Whether a series of poses stays within limits and clear of everything."""
    robot = world.mounted.robot
    if np.any(series < robot.lower) or np.any(series > robot.upper):
        return False
    every = steps_in(world, world.constants.value("motion.check"))
    looked_at = np.concatenate([series[::every], series[-1:]])
    return bool(is_free(world, world.poses(looked_at)).all())


def way(
    world: World,
    seconds: float,
    rng: np.random.Generator,
    groups: frozenset[int] = GROUPS,
) -> Float[np.ndarray, "time joint"]:
    """A robot that goes from pose to pose, with pauses, for a stream [rad].

    Args:
        world: the robot.
        seconds: how long.
        rng: to draw from.
        groups: of the poses that it pauses at.
    """
    at = draw_pose(world, groups, rng)
    parts, length, wanted = [], 0, steps_in(world, seconds)
    while length < wanted:
        pause = still(world, at, world.constants.draw("motion.pause", rng))
        leg = draw_leg(world, at, groups, rng)
        parts += [pause, leg]
        length += len(pause) + len(leg)
        at = leg[-1]
    return np.concatenate(parts)[:wanted]


def draw_leg(
    world: World,
    start: Float[np.ndarray, "joint"],
    groups: frozenset[int],
    rng: np.random.Generator,
) -> Float[np.ndarray, "time joint"]:
    """A move to another pose; where none can be reached, a turn of the base alone."""
    for _ in range(int(world.constants.value("motion.tries"))):
        leg = straight(world, start, draw_pose(world, groups, rng), rng)
        if keeps_free(world, leg):
            return leg
    end = start.copy()
    end[0] = draw_pose(world, groups, rng)[0]
    return straight(world, start, end, rng)


def straight(
    world: World,
    start: Float[np.ndarray, "joint"],
    end: Float[np.ndarray, "joint"],
    rng: np.random.Generator,
) -> Float[np.ndarray, "time joint"]:
    """A move from one pose to another, all joints together."""
    length = float(np.abs(end - start).max())
    direction = (end - start) / length
    between = start + np.linspace(0.0, 1.0, 9)[:, None] * (end - start)
    draw = world.constants.draw
    speed = min(draw("motion.speed", rng), fastest(world, between, direction))
    move = profile_of(length, speed, draw("motion.acceleration", rng))
    step = world.constants.value("time.step")
    time = step * np.arange(1, int(np.ceil(move.duration / step)) + 1)
    return start + move.at(time)[:, None] * direction
