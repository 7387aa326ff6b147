"""This module draws where a person touches the robot."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.constants import MM
from eskin.sim.contact.press import ContactSite
from eskin.sim.people.person import Person
from eskin.sim.scene.environment import World, axes_at, site_at
from eskin.sim.scene.targets import EDGE, INNER, REGIONS, SEAM, edge_distance

ALONG = np.linspace(-0.5, 0.5, 3)
"""Places across a hand's breadth that are looked at."""
AROUND = np.linspace(-0.5, 0.5, 9)
"""Places along a hand that are looked at."""


def has_room(
    world: World,
    site: ContactSite,
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
    world: World, site: ContactSite, T_world_link: Float[np.ndarray, "link 4 4"]
) -> bool:
    """Whether a finger can come to the place from outside."""
    need = world.constants.value("place.room") * MM
    link = world.links[site.chart]
    here = np.array([site.centre])
    position, _, _, normal = axes_at(world.charts[site.chart], here, T_world_link[link])
    over = position + need / 2 * normal
    return bool(world.solids.room(T_world_link, over, link)[0] >= need / 2)


def arc_is_free(
    world: World, site: ContactSite, T_world_link: Float[np.ndarray, "link 4 4"]
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


LAWS = ("poke", "double_pat", "grab", "stroke")
"""Gestures with a law of their own for where they take place."""

LIKE = {"squeeze_hold": "grab", "guiding": "grab", "squeeze": "grab", "rub": "stroke"}
LIKE |= {"tap_many": "double_pat", "single_pat": "double_pat", "tickle": "poke"}
"""What needs a place as one of those does; anything else takes any of them."""

TUBES = ("grab", "stroke")
"""Gestures that need a long tube."""


@dataclass(frozen=True, eq=False)
class View:
    """What a person sees of the robot."""

    T_world_link: Float[np.ndarray, "link 4 4"]
    """Where the links are."""
    shoulder: Float[np.ndarray, "3"]
    """Where the person's shoulder is in the world [m]."""
    heights: tuple[float, float]
    """Least and greatest z in the world that they reach [m]."""


def draw_site(
    world: World,
    q: Float[np.ndarray, "joint"],
    person: Person,
    gesture: str,
    rng: np.random.Generator,
    kind: str | None = None,
) -> ContactSite:
    """Where a person touches the robot in a pose.

    What has no law of its own takes that of poke, double pat, grab or stroke, as it
    happens, so that the place does not tell it from them.

    Args:
        world: the robot.
        q: its pose [rad].
        person: who touches.
        gesture: what they do; `none` and unknown ones too.
        rng: to draw from.
        kind: which way of doing it; some ask for a certain kind of place.

    Raises:
        ValueError: the skin has no place for it.
    """
    law = law_of(gesture, kind, rng)
    view = view_of(world, q, person)
    tries = int(world.constants.value("place.tries"))
    site = None
    for attempt in range(tries):
        # Late tries let go of reach and facing, lest a pose have no place at all.
        spot = draw_spot(world, view, law, rng, strict=2 * attempt < tries)
        if spot is not None:
            site = site_of(world, view, spot, rng)
            if has_room(world, site, law, view.T_world_link):
                return site
    if site is None:
        raise ValueError(f"no place for '{law}' on skin '{world.mounted.skin.name}'")
    return site


def law_of(gesture: str, kind: str | None, rng: np.random.Generator) -> str:
    """The gesture whose law for places is taken."""
    for name in (kind, gesture):
        if name in LAWS:
            return name
        if name in LIKE:
            return LIKE[name]
    return LAWS[rng.integers(len(LAWS))]


def view_of(world: World, q: Float[np.ndarray, "joint"], person: Person) -> View:
    """Where the robot and the person are."""
    value = world.constants.value
    table = value("robot.table")
    distance, bearing = person.stand
    size = person.acromion_height / value("place.acromion")
    low, high = world.constants.array("place.height") * size
    stand = [distance * np.cos(bearing), distance * np.sin(bearing)]
    return View(
        world.poses(q),
        np.array([*stand, person.acromion_height - table]),
        (float(low - table), float(high - table)),
    )


def draw_spot(
    world: World, view: View, law: str, rng: np.random.Generator, strict: bool
) -> int | None:
    """A place by region, by nearness to an edge, and by area, reach and facing.

    None where no place of the region that was drawn will do.
    """
    only = law in TUBES
    lists = world.spots.lists
    prior = world.constants.weights("place.regions")
    chances = np.array(
        [
            prior[name] * (len(lists[region, INNER, only]) > 0)
            for region, name in enumerate(REGIONS)
        ]
    )
    if not chances.any():
        return None
    region = int(rng.choice(len(REGIONS), p=chances / chances.sum()))
    spots = lists[region, draw_kind(world, rng), only]
    if not len(spots):
        spots = lists[region, EDGE, only]
    weights = weights_of(world, view, spots) if strict else world.spots.areas[spots]
    total = np.cumsum(weights)
    if not total[-1] > 0:
        return None
    return int(spots[np.searchsorted(total, rng.random() * total[-1], side="right")])


def draw_kind(world: World, rng: np.random.Generator) -> int:
    """Whether to aim amid a patch, near its edge, or on a seam."""
    value = world.constants.value
    drawn = rng.random()
    if drawn < value("place.seam"):
        return SEAM
    return EDGE if drawn < value("place.seam") + value("place.edge") else INNER


def weights_of(
    world: World, view: View, spots: Int[np.ndarray, "spot"]
) -> Float[np.ndarray, "spot"]:
    """Area of places, as far as the person reaches them and they face the person."""
    all_spots = world.spots
    links = np.array(world.links)[all_spots.chart[spots]]
    T = view.T_world_link[links]
    turn = "sij,sj->si"
    positions = np.einsum(turn, T[:, :3, :3], all_spots.positions[spots]) + T[:, :3, 3]
    normals = np.einsum(turn, T[:, :3, :3], all_spots.normals[spots])
    to_person = view.shoulder - positions
    cosine = np.sum(normals * to_person, axis=1) / np.linalg.norm(to_person, axis=1)
    low, high = view.heights
    within = (positions[:, 2] >= low) & (positions[:, 2] <= high)
    facing = np.maximum(cosine, 0.0) ** world.constants.value("place.facing")
    return all_spots.areas[spots] * within * facing


def site_of(world: World, view: View, spot: int, rng: np.random.Generator) -> ContactSite:
    """The site at a place that may be drawn."""
    chart = int(world.spots.chart[spot])
    return reached_at(world, view, chart, target_at(world, spot, rng))


def reached_at(
    world: World, view: View, chart: int, centre: Float[np.ndarray, "2"]
) -> ContactSite:
    """The site at a place of a chart, with the hand as it comes from the person."""
    T = view.T_world_link[world.links[chart]]
    position, *_ = axes_at(world.charts[chart], centre[None], T)
    reach = position[0] - view.shoulder
    reach = reach / np.linalg.norm(reach)
    up = world.constants.value("place.upward") * np.array([0.0, 0.0, 1.0])
    return site_at(world, chart, centre, reach + up, view.T_world_link)


def target_at(
    world: World, spot: int, rng: np.random.Generator
) -> Float[np.ndarray, "2"]:
    """A point of a place that is as near to an edge as the place is (s, t) [m]."""
    spots = world.spots
    middle = spots.unrolled[spot]
    chart = int(spots.chart[spot])
    target = middle + rng.uniform(-1.0, 1.0, 2) @ spots.half[spot]
    if spots.kind[spot] == SEAM:
        return target
    rim = spots.rims[chart]
    away = edge_distance(world.charts[chart], rim, target[None])[0]
    near = away <= world.constants.value("place.edge_within") * MM
    return target if near == (spots.kind[spot] == EDGE) else middle.copy()
