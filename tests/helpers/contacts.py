"""These helpers build presses, bodies and charts full of taxels."""

from dataclasses import replace

import numpy as np

from eskin.sim import Chart, ContactPads, Press, SoftTissue
from eskin.skin import Dome, Plane, Tube

TISSUE = SoftTissue(
    b=190.0, m=2100.0, area_scale=1.0, area_exponent=0.42, conformity=0.75
)


def build_pads(*rows):
    """Build pads from rows of x, y, R1, R2 [mm], area, most [mm2], stiffness."""
    table = np.array(rows, dtype=float)
    return ContactPads(
        centres=table[:, :2] * 1e-3,
        radii=table[:, 2:4] * 1e-3,
        angles=np.zeros(len(table)),
        area=table[:, 4] * 1e-6,
        max_area=table[:, 5] * 1e-6,
        stiffness=table[:, 6],
    )


TIP = build_pads((0, 0, 8, 20, 90, 220, 1))
FINGERS = build_pads(
    *((x, 0, 9, 45, 210, 420, 0.9) for x in (30, 10, -10, -29)),
    *((x, 25, 8.5, 35, 156, 350, 0.8) for x in (30, 10, -10, -29)),
    *((x, 45, 8, 20, 90, 220, 1) for x in (30, 10, -10, -29)),
    (0, -40, 60, 60, 1000, 1800, 0.25),
    (30, -60, 22, 35, 1200, 2200, 0.5),
)


def build_full_chart(surface, pitch=0.004, s=0.06, t=0.06):
    """Build a chart full of square taxels; a tube is covered all round."""
    if isinstance(surface, Tube):
        count = round(2 * np.pi * surface.radius / pitch)
        width = 2 * np.pi * surface.radius / count
        along_s = (np.arange(count) - count / 2) * width
    else:
        width = pitch
        along_s = np.arange(-s, s, pitch)
    along_t = np.arange(-t, t, pitch)
    places = np.stack(np.meshgrid(along_s, along_t, indexing="ij"), axis=2)
    unrolled = places.reshape(-1, 2)
    cells = np.tile(np.diag([width, pitch]) / 2, (len(unrolled), 1, 1))
    return Chart("link", surface, np.arange(len(unrolled)), unrolled, cells)


FLAT = build_full_chart(Plane(np.eye(4)), s=0.1, t=0.1)
TUBE = build_full_chart(Tube(0.0375, np.eye(4)), t=0.12)
WIDE_TUBE = build_full_chart(Tube(0.0505, np.eye(4)), t=0.12)
DOME = build_full_chart(Dome(0.0575, np.eye(4)))
CHARTS = {"flat": FLAT, "tube": TUBE, "wide tube": WIDE_TUBE, "dome": DOME}


def press(pads, force, centre=(0.001, 0.002), angle=0.3, **tissue):
    """Build a press that keeps its place; `force` is a number or a series [N]."""
    series = np.atleast_1d(np.asarray(force, dtype=float))
    return Press(
        chart=0,
        first=0,
        pads=pads,
        tissue=replace(TISSUE, **tissue),
        force=series,
        centre=np.tile(np.asarray(centre, dtype=float), (len(series), 1)),
        angle=np.full(len(series), float(angle)),
    )


def field(contact, chart, step=0):
    """Return the pressure of every taxel of a chart at one step [kPa]."""
    pressure = np.zeros(len(chart.taxels))
    pressure[np.searchsorted(chart.taxels, contact.taxels)] = contact.pressure[step]
    return pressure


def force_on(contact, chart):
    """Return the force on the taxels at every step [N]."""
    areas = 4 * np.abs(np.linalg.det(chart.cells))
    areas = areas * chart.surface.wrap(chart.unrolled).area_scale
    return 1e3 * contact.pressure @ areas[np.searchsorted(chart.taxels, contact.taxels)]
