"""This module finds patches of two links that face each other, and touches on both."""

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.constants import MM
from eskin.sim.contact.press import ContactSite, Press, TrueTouch
from eskin.sim.people.person import Person, mirror_pads
from eskin.sim.scene.environment import SimEnvironment, build_site, compute_surface_axes
from eskin.sim.scene.kernels import find_facing_points
from eskin.sim.scene.placement import build_view


@dataclass(frozen=True, eq=False)
class PatchSamples:
    """Patch samples are every n-th taxel of each chart."""

    points: Float[np.ndarray, "point 3"]
    """Positions in the frame of the chart's link [m]."""
    normals: Float[np.ndarray, "point 3"]
    """Outward unit normals in that frame."""
    areas: Float[np.ndarray, "point"]
    """Area of skin that each point represents [m2]."""
    starts: Int[np.ndarray, "chart_and_one"]
    """First point of each chart."""
    links: Int[np.ndarray, "chart"]
    """Index of the link of each chart."""
    spheres: Float[np.ndarray, "chart 4"]
    """Centre and radius of a bounding sphere of each chart [m]."""
    pairs: Int[np.ndarray, "pair 2"]
    """Pairs of charts of different links."""


@lru_cache(maxsize=4)
def sample_patches(env: SimEnvironment) -> PatchSamples:
    """Sample the taxels that folds and reachable skin are computed with."""
    skin = env.mounted.skin
    max_points = int(env.constants.value("fold.points"))
    own = [chart.taxels[chart.own] for chart in env.charts]
    chosen = [taxels[:: -(-len(taxels) // max_points)] for taxels in own]
    spheres = []
    for taxels in chosen:
        positions = skin.positions[taxels]
        centre = positions.mean(axis=0)
        radius = np.linalg.norm(positions - centre, axis=1).max()
        spheres.append(np.append(centre, radius))
    links = np.array(env.links, dtype=np.int64)
    taxels = np.concatenate(chosen)
    shares = [skin.areas[taxels].sum() for taxels in own]
    counts = [len(each) for each in chosen]
    return PatchSamples(
        points=skin.positions[taxels].astype(np.float64),
        normals=skin.normals[taxels].astype(np.float64),
        areas=np.repeat(np.array(shares) / counts, counts),
        starts=np.cumsum([0, *counts]),
        links=links,
        spheres=np.array(spheres),
        pairs=np.argwhere(np.triu(links[:, None] != links[None])).astype(np.int64),
    )


def compute_facing_gaps(
    env: SimEnvironment, T_world_link: Float[np.ndarray, "pose link 4 4"]
) -> tuple[Float[np.ndarray, "pose pair"], Int[np.ndarray, "pose pair 2"]]:
    """Return the least gap of each pair of charts that face each other [m].

    It is infinite where they do not. Gaps too thin for a hand are ignored. The second
    array holds the indices of the two nearest points of `sample_patches`.
    """
    value = env.constants.value
    samples = sample_patches(env)
    return find_facing_points(
        samples.points,
        samples.normals,
        samples.starts,
        samples.links,
        samples.spheres,
        samples.pairs,
        np.ascontiguousarray(T_world_link),
        value("fold.thinnest") * MM,
        value("fold.within") * MM,
        value("fold.facing"),
    )


def find_folded_poses(
    env: SimEnvironment, q: Float[np.ndarray, "pose joint"]
) -> Bool[np.ndarray, "pose"]:
    """Tell in which poses patches of different links face each other closely."""
    gaps, _ = compute_facing_gaps(env, env.poses(q))
    return np.min(gaps, axis=1, initial=np.inf) < np.inf


def find_fold_sites(
    env: SimEnvironment, q: Float[np.ndarray, "joint"], person: Person
) -> tuple[tuple[ContactSite, ContactSite], ...]:
    """Find pairs of sites where a hand touches two patches at once, nearest first.

    Each pair is of two charts on different links that face each other within the
    constant `fold.within`. The hand points the same way at both.
    """
    view = build_view(env, q, person)
    T_world_link = view.T_world_link
    gaps, nearest = compute_facing_gaps(env, T_world_link[None])
    samples = sample_patches(env)
    found = []
    for pair in np.argsort(gaps[0], kind="stable"):
        if not np.isfinite(gaps[0, pair]):
            break
        charts = samples.pairs[pair]
        points = samples.points[nearest[0, pair]]
        middle = transform_points(env, charts, points, T_world_link).mean(axis=0)
        ahead = middle - view.shoulder
        first, second = (
            build_site(
                env,
                int(chart),
                env.charts[chart].surface.unroll(point[None])[0],
                ahead,
                T_world_link,
            )
            for chart, point in zip(charts, points, strict=True)
        )
        found.append((first, second))
    return tuple(found)


def transform_points(
    env: SimEnvironment,
    charts: Int[np.ndarray, "point"],
    points: Float[np.ndarray, "point 3"],
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> Float[np.ndarray, "point 3"]:
    """Transform points in the frames of the links of charts to the world [m]."""
    T = T_world_link[np.array(env.links)[charts]]
    return np.einsum("pij,pj->pi", T[:, :3, :3], points) + T[:, :3, 3]


def compute_site_gap(
    env: SimEnvironment,
    q: Float[np.ndarray, "joint"],
    first: ContactSite,
    second: ContactSite,
) -> float:
    """Return the distance between two sites [m]."""
    T = env.poses(q)
    a, b = (
        compute_surface_axes(
            env.charts[site.chart], np.array([site.centre]), T[env.links[site.chart]]
        )[0][0]
        for site in (first, second)
    )
    return float(np.linalg.norm(a - b))


def compute_fold_share(
    env: SimEnvironment,
    q: Float[np.ndarray, "joint"],
    first: ContactSite,
    second: ContactSite,
) -> float:
    """Return the share of a hand's force on the second site, less at a wider gap."""
    value = env.constants.value
    gap = compute_site_gap(env, q, first, second)
    return value("fold.even") * max(0.0, 1 - gap / (value("fold.within") * MM))


def press_both_sites(
    touch: TrueTouch, first: ContactSite, second: ContactSite, share: float
) -> TrueTouch:
    """Return a touch with each press at the first site also at the second.

    `share` is the part of the force on the second site.

    Raises:
        ValueError: the share is not between 0 and 1.
    """
    if not 0 <= share <= 1:
        raise ValueError(f"share is {share}; give 0 to 1")
    presses: list[Press] = []
    for press in touch.bodies:
        if press.chart == first.chart:
            presses.append(replace(press, force=(1 - share) * press.force))
            presses.append(mirror_press(press, first, second, share))
        else:
            presses.append(press)
    drawn = touch.drawn | {"fold.share": share}
    return replace(touch, presses=tuple(presses), drawn=drawn)


def mirror_press(
    press: Press, first: ContactSite, second: ContactSite, share: float
) -> Press:
    """Return the mirrored press of the other side of the hand."""
    turn = second.angle + first.angle
    cosine = np.cos(turn)
    sine = np.sin(turn)
    s, t = (press.centre - np.array(first.centre)).T
    # A direction at an angle a from t is reflected to the angle turn - a.
    path = np.column_stack([-s * cosine - t * sine, t * cosine - s * sine])
    return replace(
        press,
        chart=second.chart,
        pads=mirror_pads(press.pads),
        force=share * press.force,
        centre=np.array(second.centre) + path,
        angle=turn - press.angle,
    )
