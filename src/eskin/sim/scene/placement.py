"""This module draws where a person touches the robot."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.constants import MM
from eskin.sim.contact.press import ContactSite
from eskin.sim.people.person import Person
from eskin.sim.scene.environment import SimEnvironment, build_site, compute_surface_axes
from eskin.sim.scene.targets import EDGE, INNER, REGIONS, SEAM, compute_edge_distance

ACROSS_HAND = np.linspace(-0.5, 0.5, 3)
"""Places across a hand's breadth that are looked at."""
ALONG_HAND = np.linspace(-0.5, 0.5, 9)
"""Places along a hand that are looked at."""


def has_room_for_hand(
    world: SimEnvironment,
    site: ContactSite,
    law: str,
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> bool:
    """Whether nothing is in the hand's way, and a stroke has its run."""
    if law == "stroke":
        low, high = site.free_run
        if high - low < world.constants.value("place.stroke_run") * MM:
            return False
    if law == "grab":
        return has_room_for_grip(world, site, T_world_link)
    return has_room_for_finger(world, site, T_world_link)


def has_room_for_finger(
    world: SimEnvironment,
    site: ContactSite,
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> bool:
    """Whether a finger can come to the place from outside."""
    need = world.constants.value("place.room") * MM
    link = world.links[site.chart]
    here = np.array([site.centre])
    position, _, _, normal = compute_surface_axes(
        world.charts[site.chart], here, T_world_link[link]
    )
    over = position + need / 2 * normal
    return bool(
        world.collision.compute_free_distance(T_world_link, over, link)[0] >= need / 2
    )


def has_room_for_grip(
    world: SimEnvironment,
    site: ContactSite,
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> bool:
    """Whether a hand fits round a tube: room over the arc that it covers."""
    value = world.constants.value
    around = ALONG_HAND * value("hand.length") * MM
    along = ACROSS_HAND * value("hand.breadth") * MM
    places = np.stack(np.meshgrid(around, along), axis=-1).reshape(-1, 2)
    link = world.links[site.chart]
    T = T_world_link[link]
    surface, *_ = compute_surface_axes(
        world.charts[site.chart], places + site.centre, T
    )
    gaps = world.collision.compute_free_distance(T_world_link, surface, link)
    return bool(np.all(gaps >= value("place.room") * MM))


PLACEMENT_LAWS = ("poke", "double_pat", "grab", "stroke")
"""Gestures with a law of their own for where they take place."""

PLACED_LIKE = {
    "squeeze_hold": "grab",
    "guiding": "grab",
    "squeeze": "grab",
    "rub": "stroke",
}
PLACED_LIKE |= {"tap_many": "double_pat", "single_pat": "double_pat", "tickle": "poke"}
"""What needs a place as one of those does; anything else takes any of them."""

TUBE_GESTURES = ("grab", "stroke")
"""Gestures that need a long tube."""


@dataclass(frozen=True, eq=False)
class PersonView:
    """What a person sees of the robot."""

    T_world_link: Float[np.ndarray, "link 4 4"]
    """Where the links are."""
    shoulder: Float[np.ndarray, "3"]
    """Where the person's shoulder is in the world [m]."""
    heights: tuple[float, float]
    """Least and greatest z in the world that they reach [m]."""


def draw_site(
    world: SimEnvironment,
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
    law = choose_placement_law(gesture, kind, rng)
    view = build_view(world, q, person)
    tries = int(world.constants.value("place.tries"))
    site = None
    for attempt in range(tries):
        # Late tries let go of reach and facing, lest a pose have no place at all.
        spot = draw_target(world, view, law, rng, strict=2 * attempt < tries)
        if spot is not None:
            site = draw_site_on_target(world, view, spot, rng)
            if has_room_for_hand(world, site, law, view.T_world_link):
                return site
    if site is None:
        raise ValueError(f"no place for '{law}' on skin '{world.mounted.skin.name}'")
    return site


def choose_placement_law(
    gesture: str, kind: str | None, rng: np.random.Generator
) -> str:
    """The gesture whose law for places is taken."""
    for name in (kind, gesture):
        if name in PLACEMENT_LAWS:
            return name
        if name in PLACED_LIKE:
            return PLACED_LIKE[name]
    return PLACEMENT_LAWS[rng.integers(len(PLACEMENT_LAWS))]


def build_view(
    world: SimEnvironment, q: Float[np.ndarray, "joint"], person: Person
) -> PersonView:
    """Where the robot and the person are."""
    value = world.constants.value
    table = value("robot.table")
    distance, bearing = person.stand
    size = person.acromion_height / value("place.acromion")
    low, high = world.constants.array("place.height") * size
    stand = [distance * np.cos(bearing), distance * np.sin(bearing)]
    return PersonView(
        world.poses(q),
        np.array([*stand, person.acromion_height - table]),
        (float(low - table), float(high - table)),
    )


def draw_target(
    world: SimEnvironment,
    view: PersonView,
    law: str,
    rng: np.random.Generator,
    strict: bool,
) -> int | None:
    """A place by region, by nearness to an edge, and by area, reach and facing.

    None where no place of the region that was drawn will do.
    """
    only = law in TUBE_GESTURES
    lists = world.targets.by_kind
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
    spots = lists[region, draw_target_kind(world, rng), only]
    if not len(spots):
        spots = lists[region, EDGE, only]
    weights = (
        compute_target_weights(world, view, spots)
        if strict
        else world.targets.areas[spots]
    )
    total = np.cumsum(weights)
    if not total[-1] > 0:
        return None
    return int(spots[np.searchsorted(total, rng.random() * total[-1], side="right")])


def draw_target_kind(world: SimEnvironment, rng: np.random.Generator) -> int:
    """Whether to aim amid a patch, near its edge, or on a seam."""
    value = world.constants.value
    drawn = rng.random()
    if drawn < value("place.seam"):
        return SEAM
    return EDGE if drawn < value("place.seam") + value("place.edge") else INNER


def compute_target_weights(
    world: SimEnvironment, view: PersonView, spots: Int[np.ndarray, "spot"]
) -> Float[np.ndarray, "spot"]:
    """Area of places, as far as the person reaches them and they face the person."""
    all_spots = world.targets
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


def draw_site_on_target(
    world: SimEnvironment, view: PersonView, spot: int, rng: np.random.Generator
) -> ContactSite:
    """The site at a place that may be drawn."""
    chart = int(world.targets.chart[spot])
    return build_reached_site(
        world, view, chart, draw_point_on_target(world, spot, rng)
    )


def build_reached_site(
    world: SimEnvironment, view: PersonView, chart: int, centre: Float[np.ndarray, "2"]
) -> ContactSite:
    """The site at a place of a chart, with the hand as it comes from the person."""
    T = view.T_world_link[world.links[chart]]
    position, *_ = compute_surface_axes(world.charts[chart], centre[None], T)
    reach = position[0] - view.shoulder
    reach = reach / np.linalg.norm(reach)
    up = world.constants.value("place.upward") * np.array([0.0, 0.0, 1.0])
    return build_site(world, chart, centre, reach + up, view.T_world_link)


def draw_point_on_target(
    world: SimEnvironment, spot: int, rng: np.random.Generator
) -> Float[np.ndarray, "2"]:
    """A point of a place that is as near to an edge as the place is (s, t) [m]."""
    spots = world.targets
    middle = spots.unrolled[spot]
    chart = int(spots.chart[spot])
    target = middle + rng.uniform(-1.0, 1.0, 2) @ spots.half_cells[spot]
    if spots.kind[spot] == SEAM:
        return target
    rim = spots.edges[chart]
    away = compute_edge_distance(world.charts[chart], rim, target[None])[0]
    near = away <= world.constants.value("place.edge_within") * MM
    return target if near == (spots.kind[spot] == EDGE) else middle.copy()
