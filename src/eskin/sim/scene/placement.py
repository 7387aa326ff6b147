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
"""Points across a hand's breadth that are checked."""
ALONG_HAND = np.linspace(-0.5, 0.5, 9)
"""Points along a hand that are checked."""


def has_room_for_hand(
    env: SimEnvironment,
    site: ContactSite,
    law: str,
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> bool:
    """Tell whether nothing is in the hand's way, and a stroke has its run."""
    if law == "stroke":
        low, high = site.free_run
        if high - low < env.constants.value("place.stroke_run") * MM:
            return False
    if law == "grab":
        return has_room_for_grip(env, site, T_world_link)
    return has_room_for_finger(env, site, T_world_link)


def has_room_for_finger(
    env: SimEnvironment,
    site: ContactSite,
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> bool:
    """Tell whether a finger can come to the site from outside."""
    need = env.constants.value("place.room") * MM
    link = env.links[site.chart]
    here = np.array([site.centre])
    position, _, _, normal = compute_surface_axes(
        env.charts[site.chart], here, T_world_link[link]
    )
    over = position + need / 2 * normal
    return bool(
        env.collision.compute_free_distance(T_world_link, over, link)[0] >= need / 2
    )


def has_room_for_grip(
    env: SimEnvironment,
    site: ContactSite,
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> bool:
    """Tell whether a hand fits round a tube: room over the arc that it covers."""
    value = env.constants.value
    around = ALONG_HAND * value("hand.length") * MM
    along = ACROSS_HAND * value("hand.breadth") * MM
    places = np.stack(np.meshgrid(around, along), axis=-1).reshape(-1, 2)
    link = env.links[site.chart]
    T = T_world_link[link]
    surface, *_ = compute_surface_axes(env.charts[site.chart], places + site.centre, T)
    gaps = env.collision.compute_free_distance(T_world_link, surface, link)
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
    """A person's view is where they stand and how far they reach."""

    T_world_link: Float[np.ndarray, "link 4 4"]
    """Poses of the links."""
    shoulder: Float[np.ndarray, "3"]
    """Position of the person's shoulder in the world [m]."""
    heights: tuple[float, float]
    """Least and greatest z in the world that the person reaches [m]."""


def draw_site(
    env: SimEnvironment,
    q: Float[np.ndarray, "joint"],
    person: Person,
    gesture: str,
    rng: np.random.Generator,
    kind: str | None = None,
) -> ContactSite:
    """Draw where a person touches the robot in a pose.

    What has no law of its own takes that of poke, double pat, grab or stroke, as it
    happens, so that the place does not tell it from them.

    Args:
        env: robot in its skin.
        q: pose [rad].
        person: person who touches.
        gesture: gesture, `none` or an unknown gesture.
        rng: random generator.
        kind: variant of the gesture; some need a certain kind of place.

    Raises:
        ValueError: the skin has no place for it.
    """
    law = choose_placement_law(gesture, kind, rng)
    view = build_view(env, q, person)
    tries = int(env.constants.value("place.tries"))
    site = None
    for attempt in range(tries):
        # Late tries ignore reach and facing, so that every pose has a place.
        index = draw_target(env, view, law, rng, strict=2 * attempt < tries)
        if index is not None:
            site = draw_site_on_target(env, view, index, rng)
            if has_room_for_hand(env, site, law, view.T_world_link):
                return site
    if site is None:
        raise ValueError(f"no place for '{law}' on skin '{env.mounted.skin.name}'")
    return site


def choose_placement_law(
    gesture: str, kind: str | None, rng: np.random.Generator
) -> str:
    """Choose the gesture whose law for places applies."""
    for name in (kind, gesture):
        if name in PLACEMENT_LAWS:
            return name
        if name in PLACED_LIKE:
            return PLACED_LIKE[name]
    return PLACEMENT_LAWS[rng.integers(len(PLACEMENT_LAWS))]


def build_view(
    env: SimEnvironment, q: Float[np.ndarray, "joint"], person: Person
) -> PersonView:
    """Return where the robot and the person are."""
    value = env.constants.value
    table = value("robot.table")
    distance, bearing = person.stand
    size = person.acromion_height / value("place.acromion")
    low, high = env.constants.array("place.height") * size
    stand = [distance * np.cos(bearing), distance * np.sin(bearing)]
    return PersonView(
        env.poses(q),
        np.array([*stand, person.acromion_height - table]),
        (float(low - table), float(high - table)),
    )


def draw_target(
    env: SimEnvironment,
    view: PersonView,
    law: str,
    rng: np.random.Generator,
    strict: bool,
) -> int | None:
    """Draw a target by region, by nearness to an edge, and by area, reach and facing.

    It is None where no target of the region that was drawn will do.
    """
    only = law in TUBE_GESTURES
    lists = env.targets.by_kind
    prior = env.constants.weights("place.regions")
    chances = np.array(
        [
            prior[name] * (len(lists[region, INNER, only]) > 0)
            for region, name in enumerate(REGIONS)
        ]
    )
    if not chances.any():
        return None
    region = int(rng.choice(len(REGIONS), p=chances / chances.sum()))
    targets = lists[region, draw_target_kind(env, rng), only]
    if not len(targets):
        targets = lists[region, EDGE, only]
    weights = (
        compute_target_weights(env, view, targets)
        if strict
        else env.targets.areas[targets]
    )
    total = np.cumsum(weights)
    if not total[-1] > 0:
        return None
    return int(targets[np.searchsorted(total, rng.random() * total[-1], side="right")])


def draw_target_kind(env: SimEnvironment, rng: np.random.Generator) -> int:
    """Draw whether to aim amid a patch, near its edge, or on a seam."""
    value = env.constants.value
    drawn = rng.random()
    if drawn < value("place.seam"):
        return SEAM
    return EDGE if drawn < value("place.seam") + value("place.edge") else INNER


def compute_target_weights(
    env: SimEnvironment, view: PersonView, targets: Int[np.ndarray, "spot"]
) -> Float[np.ndarray, "spot"]:
    """Return the areas of targets, weighted by reach and by facing the person."""
    all_spots = env.targets
    links = np.array(env.links)[all_spots.chart[targets]]
    T = view.T_world_link[links]
    turn = "sij,sj->si"
    positions = (
        np.einsum(turn, T[:, :3, :3], all_spots.positions[targets]) + T[:, :3, 3]
    )
    normals = np.einsum(turn, T[:, :3, :3], all_spots.normals[targets])
    to_person = view.shoulder - positions
    cosine = np.sum(normals * to_person, axis=1) / np.linalg.norm(to_person, axis=1)
    low, high = view.heights
    within = (positions[:, 2] >= low) & (positions[:, 2] <= high)
    facing = np.maximum(cosine, 0.0) ** env.constants.value("place.facing")
    return all_spots.areas[targets] * within * facing


def draw_site_on_target(
    env: SimEnvironment, view: PersonView, index: int, rng: np.random.Generator
) -> ContactSite:
    """Draw the site on a target."""
    chart = int(env.targets.chart[index])
    return build_reached_site(env, view, chart, draw_point_on_target(env, index, rng))


def build_reached_site(
    env: SimEnvironment, view: PersonView, chart: int, centre: Float[np.ndarray, "2"]
) -> ContactSite:
    """Build the site at a point of a chart, with the hand as the person reaches it."""
    T = view.T_world_link[env.links[chart]]
    position, *_ = compute_surface_axes(env.charts[chart], centre[None], T)
    reach = position[0] - view.shoulder
    reach = reach / np.linalg.norm(reach)
    up = env.constants.value("place.upward") * np.array([0.0, 0.0, 1.0])
    return build_site(env, chart, centre, reach + up, view.T_world_link)


def draw_point_on_target(
    env: SimEnvironment, index: int, rng: np.random.Generator
) -> Float[np.ndarray, "2"]:
    """Draw a point (s, t) [m] of a target, as near to an edge as the target is."""
    targets = env.targets
    middle = targets.unrolled[index]
    chart = int(targets.chart[index])
    target = middle + rng.uniform(-1.0, 1.0, 2) @ targets.half_cells[index]
    if targets.kind[index] == SEAM:
        return target
    edges = targets.edges[chart]
    away = compute_edge_distance(env.charts[chart], edges, target[None])[0]
    near = away <= env.constants.value("place.edge_within") * MM
    return target if near == (targets.kind[index] == EDGE) else middle.copy()
