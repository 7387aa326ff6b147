"""A place that is pointed at, and the chart that it is on."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from eskin.sim.people.person import Person
from eskin.sim.robot.world import World
from eskin.sim.site.place import reached_at, view_of
from eskin.sim.site.site import Site


@dataclass(frozen=True, eq=False)
class Place:
    """A point on the skin, or near it."""

    link: str
    """Link that the skin is on."""
    p_link: Float[np.ndarray, "3"]
    """Where, in that link's frame [m]."""


def on_chart(place: Place, world: World) -> tuple[int, Float[np.ndarray, "2"]]:
    """The chart of the nearest taxel of the place's link, and the place on it (s, t).

    Raises:
        ValueError: there is no skin on that link.
    """
    charts = [i for i, chart in enumerate(world.charts) if chart.link == place.link]
    if not charts:
        allowed = ", ".join(sorted({chart.link for chart in world.charts}))
        raise ValueError(
            f"no skin on link '{place.link}'; allowed are {allowed}; touch one of them"
        )
    positions = world.mounted.skin.positions
    away = [
        np.linalg.norm(positions[world.charts[i].taxels] - place.p_link, axis=1).min()
        for i in charts
    ]
    chart = charts[int(np.argmin(away))]
    return chart, world.charts[chart].surface.unroll(place.p_link[None])[0]


def site_for(
    place: Place, world: World, q: Float[np.ndarray, "joint"], person: Person
) -> Site:
    """The site at a place, with the hand as it comes from a person.

    Raises:
        ValueError: there is no skin on the place's link.
    """
    chart, centre = on_chart(place, world)
    return reached_at(world, view_of(world, q, person), chart, centre)
