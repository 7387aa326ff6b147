"""What moves over a link that moves: a hand that follows late, or what hangs still."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from eskin.sim.contact.press import Press
from eskin.sim.robot.tangent import angle_of, axes_at, direction_of
from eskin.sim.robot.world import World


def follow(
    press: Press,
    world: World,
    q_series: Float[np.ndarray, "time joint"],
    delay: float,
) -> Press:
    """A press by a hand that follows the moving robot with a delay.

    At each instant the hand is where its target was a delay ago, but never earlier
    than when it touched: it lands on the target, and slides until it has caught up.

    Args:
        press: what it would do to a robot at rest.
        world: the robot.
        q_series: poses at the steps of the scene's clock [rad].
        delay: of the hand [s].
    """
    now = press.first + np.arange(press.steps, dtype=np.float64)
    late = now - delay / world.constants.value("time.step")
    return carried(press, world, q_series, now, np.maximum(late, now[0]))


def drag(
    press: Press, world: World, q_series: Float[np.ndarray, "time joint"]
) -> Press:
    """A press by what hangs still in the world, such as a cable, while a link moves.

    Args:
        press: what it would do to a robot at rest.
        world: the robot.
        q_series: poses at the steps of the scene's clock [rad].
    """
    now = press.first + np.arange(press.steps, dtype=np.float64)
    return carried(press, world, q_series, now, np.full_like(now, now[0]))


def carried(
    press: Press,
    world: World,
    q_series: Float[np.ndarray, "time joint"],
    now: Float[np.ndarray, "step"],
    then: Float[np.ndarray, "step"],
) -> Press:
    """The press with its hand at some steps of a series where it was at others."""
    if np.all(q_series == q_series[0]):
        return press
    return left_behind(press, world, at_steps(q_series, now), at_steps(q_series, then))


def left_behind(
    press: Press,
    world: World,
    q_now: Float[np.ndarray, "step joint"],
    q_then: Float[np.ndarray, "step joint"],
) -> Press:
    """The press where T_link(now)^-1 T_link(then) takes its targets and its angle."""
    link, chart = world.links[press.chart], world.charts[press.chart]
    T_now, T_then = world.poses(q_now)[:, link], world.poses(q_then)[:, link]
    was, s_then, t_then, _ = axes_at(chart, press.centre, T_then)
    here, s_now, t_now, _ = axes_at(chart, press.centre, T_now)
    # Laid flat where the target is: a hand leaves a tube rather than dives into it.
    slid = [np.sum((was - here) * axis, axis=1) for axis in (s_now, t_now)]
    turned = angle_of(direction_of(press.angle, s_then, t_then), s_now, t_now)
    turn = (turned - press.angle + np.pi) % (2 * np.pi) - np.pi
    return replace(
        press,
        centre=press.centre + np.column_stack(slid),
        angle=press.angle + turn,
    )


def at_steps(
    q_series: Float[np.ndarray, "time joint"], steps: Float[np.ndarray, "step"]
) -> Float[np.ndarray, "step joint"]:
    """Poses between and beyond steps: before the first, as fast as right after it."""
    last = len(q_series) - 1
    if last == 0:
        return np.tile(q_series[0], (len(steps), 1))
    low = np.clip(np.floor(steps).astype(np.int64), 0, last - 1)
    share = np.minimum(steps, last) - low
    return q_series[low] + share[:, None] * (q_series[low + 1] - q_series[low])
