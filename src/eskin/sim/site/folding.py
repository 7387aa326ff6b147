"""Where patches of different links face each other closely, as in a folded arm."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.sim.people.hand import MM
from eskin.sim.robot.world import World
from eskin.sim.site.folding_kernels import facing_gaps


@dataclass(frozen=True, eq=False)
class Faces:
    """Some taxels of each chart, evenly spread."""

    points: Float[np.ndarray, "point 3"]
    """In the frame of the chart's link [m]."""
    normals: Float[np.ndarray, "point 3"]
    """Outward, in that frame."""
    areas: Float[np.ndarray, "point"]
    """Skin that each stands for [m2]."""
    starts: Int[np.ndarray, "chart_and_one"]
    """First point of each chart."""
    links: Int[np.ndarray, "chart"]
    """Index of the link of each chart."""
    balls: Float[np.ndarray, "chart 4"]
    """Middle and radius of a ball about each chart [m]."""
    pairs: Int[np.ndarray, "pair 2"]
    """Charts of different links."""


@lru_cache(maxsize=4)
def faces_of(world: World) -> Faces:
    """The taxels that folds are sought by."""
    skin = world.mounted.skin
    most = int(world.constants.value("fold.points"))
    chosen = [chart.taxels[:: -(-len(chart.taxels) // most)] for chart in world.charts]
    balls = []
    for taxels in chosen:
        at = skin.positions[taxels]
        reach = np.linalg.norm(at - at.mean(axis=0), axis=1).max()
        balls.append(np.append(at.mean(axis=0), reach))
    links = np.array(world.links, dtype=np.int64)
    taxels = np.concatenate(chosen)
    shares = [skin.areas[chart.taxels].sum() for chart in world.charts]
    counts = [len(each) for each in chosen]
    return Faces(
        points=skin.positions[taxels].astype(np.float64),
        normals=skin.normals[taxels].astype(np.float64),
        areas=np.repeat(np.array(shares) / counts, counts),
        starts=np.cumsum([0, *counts]),
        links=links,
        balls=np.array(balls),
        pairs=np.argwhere(np.triu(links[:, None] != links[None])).astype(np.int64),
    )


def facing(
    world: World, T_world_link: Float[np.ndarray, "pose link 4 4"]
) -> tuple[Float[np.ndarray, "pose pair"], Int[np.ndarray, "pose pair 2"]]:
    """Least gap of each pair of charts [m], infinite if they do not face each other.

    Gaps too thin for a hand do not count. The second array tells the two points of
    `faces_of` that are nearest.
    """
    value = world.constants.value
    least, within = value("fold.thinnest") * MM, value("fold.within") * MM
    faces = faces_of(world)
    return facing_gaps(
        *(faces.points, faces.normals, faces.starts, faces.links),
        *(faces.balls, faces.pairs, np.ascontiguousarray(T_world_link)),
        *(least, within, value("fold.facing")),
    )


def folds_at(
    world: World, q: Float[np.ndarray, "pose joint"]
) -> Bool[np.ndarray, "pose"]:
    """In which poses patches of different links face each other closely."""
    gaps, _ = facing(world, world.poses(q))
    return np.min(gaps, axis=1, initial=np.inf) < np.inf
