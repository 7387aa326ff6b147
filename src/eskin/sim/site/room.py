"""Whether a hand has the room that a gesture needs."""

import numpy as np
from jaxtyping import Float

from eskin.sim.people.hand import MM
from eskin.sim.robot.tangent import axes_at
from eskin.sim.robot.world import World
from eskin.sim.site.site import Site

ALONG = np.linspace(-0.5, 0.5, 3)
"""Places across a hand's breadth that are looked at."""
AROUND = np.linspace(-0.5, 0.5, 9)
"""Places along a hand that are looked at."""


def has_room(
    world: World,
    site: Site,
    law: str,
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> bool:
    """Whether nothing is in the hand's way, and a stroke has its run."""
    if law == "stroke":
        low, high = site.clear
        if high - low < world.constants.value("place.stroke_run") * MM:
            return False
    if law == "grab":
        return arc_is_free(world, site, T_world_link)
    return is_open(world, site, T_world_link)


def is_open(
    world: World, site: Site, T_world_link: Float[np.ndarray, "link 4 4"]
) -> bool:
    """Whether a finger can come to the place from outside."""
    need = world.constants.value("place.room") * MM
    link = world.links[site.chart]
    here = np.array([site.centre])
    position, _, _, normal = axes_at(world.charts[site.chart], here, T_world_link[link])
    over = position + need / 2 * normal
    return bool(world.solids.room(T_world_link, over, link)[0] >= need / 2)


def arc_is_free(
    world: World, site: Site, T_world_link: Float[np.ndarray, "link 4 4"]
) -> bool:
    """Whether a hand fits round a tube: room over the arc that it covers."""
    value = world.constants.value
    around = AROUND * value("hand.length") * MM
    along = ALONG * value("hand.breadth") * MM
    places = np.stack(np.meshgrid(around, along), axis=-1).reshape(-1, 2)
    link = world.links[site.chart]
    T = T_world_link[link]
    surface, *_ = axes_at(world.charts[site.chart], places + site.centre, T)
    gaps = world.solids.room(T_world_link, surface, link)
    return bool(np.all(gaps >= value("place.room") * MM))
