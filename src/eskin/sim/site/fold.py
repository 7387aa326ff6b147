"""A hand between two patches that face each other, touching both."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.clip.truth import TrueTouch
from eskin.sim.contact.press import Press
from eskin.sim.people.hand import MM, mirrored
from eskin.sim.people.person import Person
from eskin.sim.robot.tangent import axes_at, site_at
from eskin.sim.robot.world import World
from eskin.sim.site.folding import faces_of, facing
from eskin.sim.site.place import view_of
from eskin.sim.site.site import Site


def fold_sites(
    world: World, q: Float[np.ndarray, "joint"], person: Person
) -> tuple[tuple[Site, Site], ...]:
    """Pairs of places where a hand touches two patches at once, nearest first.

    Each pair is of two charts on different links that face each other within
    `fold.within`. The hand points the same way at both.
    """
    view = view_of(world, q, person)
    gaps, which = facing(world, view.T_world_link[None])
    faces = faces_of(world)
    found = []
    for pair in np.argsort(gaps[0], kind="stable"):
        if np.isfinite(gaps[0, pair]):
            points = faces.points[which[0, pair]]
            charts = faces.pairs[pair]
            middle = points_in_world(world, charts, points, view.T_world_link).mean(0)
            ahead = middle - view.shoulder
            first, second = (
                site_at(
                    world,
                    int(chart),
                    world.charts[chart].surface.unroll(point[None])[0],
                    ahead,
                    view.T_world_link,
                )
                for chart, point in zip(charts, points, strict=True)
            )
            found.append((first, second))
    return tuple(found)


def points_in_world(
    world: World,
    charts: Int[np.ndarray, "point"],
    points: Float[np.ndarray, "point 3"],
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> Float[np.ndarray, "point 3"]:
    """Points of the links of charts in the world [m]."""
    T = T_world_link[np.array(world.links)[charts]]
    return np.einsum("pij,pj->pi", T[:, :3, :3], points) + T[:, :3, 3]


def gap_of(
    world: World, q: Float[np.ndarray, "joint"], first: Site, second: Site
) -> float:
    """Distance of two sites in space [m]."""
    T = world.poses(q)
    one, other = (
        axes_at(
            world.charts[site.chart],
            np.array([site.centre]),
            T[world.links[site.chart]],
        )[0][0]
        for site in (first, second)
    )
    return float(np.linalg.norm(one - other))


def share_of(
    world: World, q: Float[np.ndarray, "joint"], first: Site, second: Site
) -> float:
    """Share of a hand's force that the second site bears: less, the wider the gap."""
    value = world.constants.value
    gap = gap_of(world, q, first, second)
    return value("fold.even") * max(0.0, 1 - gap / (value("fold.within") * MM))


def fold(touch: TrueTouch, first: Site, second: Site, share: float) -> TrueTouch:
    """The same touch with each press at the first site also at the second.

    Args:
        touch: what is done at the first site.
        first: where.
        second: the place that faces it.
        share: of the force, that the second bears.

    Raises:
        ValueError: the share is no share.
    """
    if not 0 <= share <= 1:
        raise ValueError(f"share is {share}; give 0 to 1")
    presses: list[Press] = []
    for press in touch.presses:
        if press.chart == first.chart:
            presses.append(replace(press, force=(1 - share) * press.force))
            presses.append(opposite(press, first, second, share))
        else:
            presses.append(press)
    return replace(
        touch, presses=tuple(presses), drawn=touch.drawn | {"fold.share": share}
    )


def opposite(press: Press, first: Site, second: Site, share: float) -> Press:
    """The press of the other side of the hand, seen from there as in a mirror."""
    turn = second.angle + first.angle
    path = press.centre - np.array(first.centre)
    return replace(
        press,
        chart=second.chart,
        stamps=mirrored(press.stamps),
        force=share * press.force,
        centre=np.array(second.centre) + reflected(path, turn),
        angle=turn - press.angle,
    )


def reflected(
    path: Float[np.ndarray, "time 2"], turn: float
) -> Float[np.ndarray, "time 2"]:
    """A path whose directions, at angles a from t, come to be at turn - a."""
    cosine, sine = np.cos(turn), np.sin(turn)
    s, t = path.T
    return np.column_stack([-s * cosine - t * sine, t * cosine - s * sine])
