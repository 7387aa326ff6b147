"""How deep, how wide and where each part of a body dents a surface."""

import numpy as np
from jaxtyping import Float

from eskin.sim.constants import Constants
from eskin.sim.contact.chart import Chart
from eskin.sim.contact.contact_kernels import Dents, cover, share
from eskin.sim.contact.press import Flesh, Press, Stamps
from eskin.skin.round import Dome, Tube

MM = 1e-3
KPA = 1e-3

Lengths = Float[np.ndarray, "time part"]
Points = Float[np.ndarray, "time part 2"]


def dents_of(
    press: Press, chart: Chart, constants: Constants
) -> tuple[Dents, Float[np.ndarray, "time"], Float[np.ndarray, "time 2"]]:
    """Ellipses under a press, its true area of contact [m2] and its centroid [m]."""
    offsets = placed(press)
    long = long_axes(press)
    curvatures = relative_curvatures(press.stamps, chart, long)
    centres = laid(press, chart, offsets)
    off = gaps(press.flesh, chart, offsets)
    off[chart.beyond(centres)] = constants.value("contact.off")
    loads = share_load(press, off, constants)
    areas = contact_areas(press, curvatures, loads, constants)
    ratio = np.sqrt(curvatures[..., 0] / curvatures[..., 1])
    across = np.sqrt(areas / np.pi / ratio)
    axes = np.stack([across, across * ratio], axis=2)
    safe = np.where(areas > 0.0, areas, 1.0)
    peak = 2.0 * loads / safe * KPA
    dents = Dents(centres, long, axes, peak)
    area = cover(dents, constants.value("contact.touched"), SPOTS)
    return dents, area, centroid_of(press, centres, loads)


def placed(press: Press) -> Points:
    """Where the parts lie about the press's centre, as arc lengths (s, t) [m]."""
    from_middle = press.stamps.centres - press.stamps.centres.mean(axis=0)
    cos, sin = np.cos(press.angle)[:, None], np.sin(press.angle)[:, None]
    x, y = from_middle.T
    return np.stack([x * cos - y * sin, x * sin + y * cos], axis=2)


def long_axes(press: Press) -> Points:
    """Unit vectors (s, t) of the parts' long axes."""
    turned = press.angle[:, None] + press.stamps.turns
    return np.stack([-np.sin(turned), np.cos(turned)], axis=2)


def relative_curvatures(stamps: Stamps, chart: Chart, long: Points) -> Points:
    """Curvature of each part against the surface, across and along it [1/m]."""
    own = np.broadcast_to(1.0 / stamps.radii, long.shape)
    if isinstance(chart.surface, Tube):
        # The long axis leans on the tube's roundness by its share of s.
        return own + long[..., ::-1] ** 2 / chart.radius
    if isinstance(chart.surface, Dome):
        return own + 1.0 / chart.radius
    return own


def gaps(flesh: Flesh, chart: Chart, offsets: Points) -> Lengths:
    """How far the parts stay off a round surface that the body wraps poorly [m]."""
    round_way = np.zeros(offsets.shape[:2])
    if isinstance(chart.surface, Tube | Dome):
        round_way = offsets[..., 0] ** 2
    if isinstance(chart.surface, Dome):
        round_way = round_way + offsets[..., 1] ** 2
    return (1.0 - flesh.conformity) * round_way / (2.0 * chart.radius)


def share_load(press: Press, gaps: Lengths, constants: Constants) -> Lengths:
    """Load of each part [N]; they sum to the force exactly."""
    return share(
        *(press.force, gaps, press.stamps.stiffness, press.flesh.b, press.flesh.m),
        constants.value("contact.deepest") * MM,
        int(constants.value("contact.halvings")),
    )


def contact_areas(
    press: Press, curvatures: Points, loads: Lengths, constants: Constants
) -> Lengths:
    """Area of each ellipse [m2]: a power of its load, smaller on a rounder surface."""
    stamps, flesh = press.stamps, press.flesh
    grown = flesh.area_scale * stamps.area * loads**flesh.area_exponent
    flat = np.prod(1.0 / stamps.radii, axis=1)
    rounder = np.sqrt(flat / np.prod(curvatures, axis=2))
    exponent = constants.value("contact.curvature_exponent")
    return np.minimum(stamps.most, grown) * rounder**exponent


def laid(press: Press, chart: Chart, offsets: Points) -> Points:
    """Centres of the parts, unrolled (s, t) [m]."""
    start = press.centre[:, None]
    if not isinstance(chart.surface, Dome):
        return start + offsets
    return start + stretched(start, offsets, chart.radius)


TURNS = 4


def stretched(start: np.ndarray, offsets: Points, radius: float) -> Points:
    """Steps on a dome's polar chart that are offsets in its tangent planes [m].

    The chart is taken at the middle of each step, which is found by repetition.
    """
    steps = offsets
    for _ in range(TURNS):
        middle = start + steps / 2
        away = np.linalg.norm(middle, axis=2, keepdims=True)
        outward = middle / np.where(away > 0.0, away, 1.0)
        radial = np.sum(offsets * outward, axis=2, keepdims=True) * outward
        steps = radial + (offsets - radial) / np.sinc(away / radius / np.pi)
    return steps


def spread_spots(count: int) -> Float[np.ndarray, "spot 2"]:
    """Points that fill the unit disc evenly, in the order of a sunflower's seeds."""
    index = np.arange(count)
    turn = index * np.pi * (3.0 - np.sqrt(5.0))
    away = np.sqrt((index + 0.5) / count)
    return np.column_stack([away * np.cos(turn), away * np.sin(turn)])


SPOTS = spread_spots(16)


def centroid_of(
    press: Press, centres: Points, loads: Lengths
) -> Float[np.ndarray, "time 2"]:
    """Where the force acts, unrolled (s, t) [m]; the press's centre without one."""
    total = loads.sum(axis=1)
    moment = np.einsum("tk,tkd->td", loads, centres)
    mean = moment / np.where(total > 0.0, total, 1.0)[:, None]
    return np.where(total[:, None] > 0.0, mean, press.centre)
