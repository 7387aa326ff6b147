"""This module draws contact sites: where a person touches the robot."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from eskin.sim.constants import MM
from eskin.sim.contact.press import ContactSite
from eskin.sim.people.person import Person
from eskin.sim.scene.environment import SimEnvironment, build_site, compute_surface_axes
from eskin.sim.scene.targets import (
    CLOSE,
    EDGE,
    INNER,
    REGIONS,
    SEAM,
    SLIDE,
    compute_edge_distance,
)

ACROSS_HAND = np.linspace(-0.5, 0.5, 3)
"""Checked points across a hand, as shares of its breadth."""
ALONG_HAND = np.linspace(-0.5, 0.5, 9)
"""Checked points along a hand, as shares of its length."""


def has_room_for_hand(
    env: SimEnvironment,
    site: ContactSite,
    law: str,
    T_world_link: Float[np.ndarray, "link 4 4"],
) -> bool:
    """Tell whether a hand has room at a site.

    A stroke needs a free run, a grab room round the tube over the whole hand, and other
    gestures room for a finger that comes from outside.
    """
    value = env.constants.value
    link = env.links[site.chart]
    if law == "stroke":
        low, high = site.free_run
        if high - low < value("place.stroke_run") * MM:
            return False
    needed = value("place.room") * MM
    offsets = np.zeros((1, 2))
    if law == "grab":
        around = ALONG_HAND * value("hand.length") * MM
        along = ACROSS_HAND * value("hand.breadth") * MM
        offsets = np.stack(np.meshgrid(around, along), axis=-1).reshape(-1, 2)
    points, _, _, normals = compute_surface_axes(
        env.charts[site.chart], offsets + site.centre, T_world_link[link]
    )
    if law != "grab":
        needed = needed / 2
        points = points + needed * normals
    distances = env.collision.compute_free_distance(T_world_link, points, link)
    return bool(np.all(distances >= needed))


PLACEMENT_LAWS = ("poke", "double_pat", "grab", "stroke")
"""Gestures with a placement law, the distribution of their sites, of their own."""

SHARED_LAWS = {
    "squeeze_hold": "grab",
    "guiding": "grab",
    "squeeze": "grab",
    "rub": "stroke",
    "tap_many": "double_pat",
    "single_pat": "double_pat",
    "tickle": "poke",
}
"""Placement laws of other gestures and kinds; the rest take one at random."""

NEEDS = {"grab": CLOSE, "stroke": SLIDE}
"""What the places of placement laws must allow."""


@dataclass(frozen=True, eq=False)
class PersonView:
    """A person's view holds the robot's pose and where the person reaches it from."""

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

    Gestures without a placement law take one of those of poke, double pat, grab and
    stroke at random, so that the place does not distinguish them. Some kinds need a
    certain kind of place; where the skin has none such, they take any.
    """
    law = choose_placement_law(gesture, kind, rng)
    view = build_view(env, q, person)
    tries = int(env.constants.value("place.tries"))
    site = None
    for attempt in range(tries):
        # The second half of the tries ignores reach and facing: every pose has a site.
        index = draw_target(env, view, law, rng, strict=2 * attempt < tries)
        if index is not None:
            centre = draw_point_on_target(env, index, rng)
            chart = int(env.targets.chart[index])
            site = build_reached_site(env, view, chart, centre)
            if has_room_for_hand(env, site, law, view.T_world_link):
                return site
    assert site is not None
    return site


def choose_site(
    env: SimEnvironment,
    q: Float[np.ndarray, "joint"],
    person: Person,
    gesture: str,
    places: Iterable[np.random.Generator],
    kind: str | None = None,
) -> ContactSite:
    """Choose the first of some places of the skin where a hand has room in a pose.

    A place is drawn by its own generator from region, kind and area alone, so that it
    is the same in every pose and for every person. Where no place has room it is the
    last one.
    """
    view = build_view(env, q, person)
    site = None
    for rng in places:
        law = choose_placement_law(gesture, kind, rng)
        index = draw_target(env, view, law, rng, strict=False)
        assert index is not None
        centre = draw_point_on_target(env, index, rng)
        site = build_reached_site(env, view, int(env.targets.chart[index]), centre)
        if has_room_for_hand(env, site, law, view.T_world_link):
            return site
    assert site is not None
    return site


def choose_placement_law(
    gesture: str, kind: str | None, rng: np.random.Generator
) -> str:
    """Choose the placement law of a kind or gesture, at random if it has none."""
    for name in (kind, gesture):
        if name in PLACEMENT_LAWS:
            return name
        if name in SHARED_LAWS:
            return SHARED_LAWS[name]
    return PLACEMENT_LAWS[rng.integers(len(PLACEMENT_LAWS))]


def build_view(
    env: SimEnvironment, q: Float[np.ndarray, "joint"], person: Person
) -> PersonView:
    """Build the view of a person who touches the robot in a pose."""
    value = env.constants.value
    table = env.base_height
    distance, bearing = person.stand
    size = person.acromion_height / value("place.acromion")
    low, high = env.constants.array("place.height") * size
    x, y = distance * np.cos(bearing), distance * np.sin(bearing)
    return PersonView(
        env.poses(q),
        np.array([x, y, person.acromion_height - table]),
        (float(low - table), float(high - table)),
    )


def draw_target(
    env: SimEnvironment,
    view: PersonView,
    law: str,
    rng: np.random.Generator,
    strict: bool,
) -> int | None:
    """Draw a target by region, by kind, and by area, reach and facing.

    It is None if no target of the drawn region and kind is in reach.
    """
    needed = NEEDS.get(law, 0)
    # A hand that cannot close round anything lies on the skin.
    needed = min(needed, max(env.targets.allows))
    by_kind = env.targets.by_kind
    prior = env.constants.weights("place.regions")
    inner, edge = (
        np.array(
            [
                prior[name] * (len(by_kind[region, kind, needed]) > 0)
                for region, name in enumerate(REGIONS)
            ]
        )
        for kind in (INNER, EDGE)
    )
    # All of a narrow skin is near an edge.
    chances = inner if inner.any() else edge
    region = int(rng.choice(len(REGIONS), p=chances / chances.sum()))
    drawn = rng.random()
    seam = env.constants.value("place.seam")
    kind = EDGE if drawn < seam + env.constants.value("place.edge") else INNER
    targets = by_kind[region, SEAM if drawn < seam else kind, needed]
    if not len(targets):
        targets = by_kind[region, EDGE, needed]
    weights = (
        compute_target_weights(env, view, targets)
        if strict
        else env.targets.areas[targets]
    )
    total = np.cumsum(weights)
    if not total[-1] > 0:
        return None
    return int(targets[np.searchsorted(total, rng.random() * total[-1], side="right")])


def compute_target_weights(
    env: SimEnvironment, view: PersonView, targets: Int[np.ndarray, "target"]
) -> Float[np.ndarray, "target"]:
    """Return the areas of targets, weighted by reach and by facing the person."""
    all_targets = env.targets
    links = np.array(env.links)[all_targets.chart[targets]]
    T = view.T_world_link[links]
    R = T[:, :3, :3]
    p = T[:, :3, 3]
    positions = np.einsum("tij,tj->ti", R, all_targets.positions[targets]) + p
    normals = np.einsum("tij,tj->ti", R, all_targets.normals[targets])
    to_person = view.shoulder - positions
    cosine = np.sum(normals * to_person, axis=1) / np.linalg.norm(to_person, axis=1)
    low, high = view.heights
    within = (positions[:, 2] >= low) & (positions[:, 2] <= high)
    facing = np.maximum(cosine, 0.0) ** env.constants.value("place.facing")
    return all_targets.areas[targets] * within * facing


def build_reached_site(
    env: SimEnvironment, view: PersonView, chart: int, centre: Float[np.ndarray, "2"]
) -> ContactSite:
    """Build the site at a point of a chart, the hand oriented as the person reaches."""
    T = view.T_world_link[env.links[chart]]
    position, *_ = compute_surface_axes(env.charts[chart], centre[None], T)
    reach = position[0] - view.shoulder
    reach = reach / np.linalg.norm(reach)
    up = env.constants.value("place.upward") * np.array([0.0, 0.0, 1.0])
    return build_site(env, chart, centre, reach + up, view.T_world_link)


def draw_point_on_target(
    env: SimEnvironment, index: int, rng: np.random.Generator
) -> Float[np.ndarray, "2"]:
    """Draw a point (s, t) of a target that is near an edge if the target is [m]."""
    targets = env.targets
    middle = targets.unrolled[index]
    kind = targets.kind[index]
    point = middle + rng.uniform(-1.0, 1.0, 2) @ targets.half_cells[index]
    if kind == SEAM:
        return point
    chart = int(targets.chart[index])
    edges = targets.edges[chart]
    distance = compute_edge_distance(env.charts[chart], edges, point[None])[0]
    near = distance <= env.constants.value("place.edge_within") * MM
    return point if near == (kind == EDGE) else middle.copy()
