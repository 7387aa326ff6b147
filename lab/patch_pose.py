"""Measure how well the pose of a mounted patch is recovered from presses.

    python -m lab.patch_pose --draws 200

In every draw a patch of the ur5 skin is shifted by 10 mm and turned by 10 degrees, in
directions drawn at random, and pressed by simulated fingertips at ten known points,
those of `eskin skin points`. The points are marked and measured with an error, the
finger misses them, its force and size vary, and so do the gains of the taxels.
"""

import argparse
from dataclasses import dataclass, replace

import numpy as np

from eskin.calibration.pose import (
    choose_taxels,
    estimate_pose,
    find_felt_point,
    linearise,
)
from eskin.robot import load_robot
from eskin.sim import Chart, Press, build_charts, load_constants
from eskin.sim.contact.pressure import compute_pressure_field
from eskin.sim.people.person import draw_person
from eskin.skin import MountedSkin, load_skin
from eskin.transforms import apply, exp_so3, log_so3, make_transform
from lab.tables import format_head, format_row

SHIFT, TURN = 0.010, np.deg2rad(10.0)
"""Offset of a patch [m], [rad]."""
PRESSES = 10
AIM = 0.0007
"""Deviation of a finger from its point in each direction along the surface [m]."""
MEASURED = 0.0003
"""Deviation of the coordinates of a known point, in each direction [m]."""
FORCES = (5.0, 15.0)
"""Least and largest force of a press [N]."""
GAINS = 0.1
"""Standard deviation of ln gain of a taxel."""
LEAST = 2.0
"""Pressure from which a taxel counts as pressed [kPa]."""
MARKED = 0.002
"""Largest distance of a point from its taxel, in each direction along the surface [m].
"""
BOUND_DRAWS = 50
"""Number of errors that are drawn of the bound of each draw."""
PATCHES = ("forearm_front", "elbow_cap", "wrist_1", "wrist_1_cap")


@dataclass(frozen=True)
class PoseDraw:
    """A draw holds the errors of one estimate."""

    shift: float
    """Length of the error of the middle of the patch [mm]."""
    turn: float
    """Angle of the error of its rotation [deg]."""
    contained: bool
    """Whether the 95 % region contains the truth."""
    bound: np.ndarray
    """Errors of the rotation that the Cramer-Rao bound leaves [deg]."""


def compute_bound(
    arm: np.ndarray, normals: np.ndarray, rng: np.random.Generator
) -> np.ndarray:
    """Draw angles of the error that the Cramer-Rao bound leaves [deg].

    It is that of an estimator which knows the deviations of fingers and coordinates, of
    presses that are felt exactly where the finger is.
    """
    noise = (float(np.hypot(AIM, MEASURED)), MEASURED)
    jacobian, weights, _ = linearise(arm, normals, noise)
    squares = np.einsum("pia,pij,pjb->ab", jacobian, weights, jacobian)
    covariance = np.linalg.inv(squares)[:3, :3]
    errors = rng.multivariate_normal(np.zeros(3), covariance, BOUND_DRAWS)
    return np.rad2deg(np.linalg.norm(errors, axis=1))


def draw_unit(rng: np.random.Generator) -> np.ndarray:
    """Draw a direction."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def draw_estimate(
    mounted: MountedSkin,
    patch: str,
    chart: Chart,
    number: int,
    rng: np.random.Generator,
) -> PoseDraw:
    """Press a moved patch, and estimate how it was moved."""
    skin, constants = mounted.skin, load_constants()
    taxels = skin.find_taxels(patch)
    inside = np.isin(chart.taxels, taxels)
    own = chart.unrolled[inside]
    centre = skin.positions[taxels].mean(axis=0)
    turn = exp_so3(TURN * draw_unit(rng))
    T = make_transform(turn, centre + SHIFT * draw_unit(rng) - turn @ centre)
    person = draw_person("presser", constants, np.random.default_rng([number, 7]))
    pads = person.select_pads("one_tip")
    gains = np.exp(GAINS * rng.normal(size=skin.count))
    chosen = choose_taxels(skin, patch, PRESSES)
    known, felt, normals = [], [], []
    for place in own[np.searchsorted(chart.taxels[inside], chosen)]:
        place = place + rng.uniform(-MARKED, MARKED, 2)
        aimed = place + AIM * rng.normal(size=2)
        press = Press(
            0,
            0,
            np.array([rng.uniform(*FORCES)]),
            aimed[None],
            rng.uniform(-np.pi, np.pi, 1),
            pads,
            person.tissue,
        )
        field = compute_pressure_field(press, replace(chart, rim=np.inf), constants)
        shown = field.pressure[0] * gains[field.taxels]
        kept = (shown >= LEAST) & np.isin(field.taxels, taxels)
        point, normal = find_felt_point(skin, field.taxels[kept], shown[kept])
        felt.append(point)
        normals.append(normal)
        true = apply(T, chart.surface.wrap(place[None]).positions[0])
        known.append(true + MEASURED * rng.normal(size=3))
    found = estimate_pose(
        skin, patch, np.array(known), np.array(felt), np.array(normals)
    )
    error = log_so3(found.T_true_file[:3, :3] @ turn.T)
    away = apply(found.T_true_file, centre) - apply(T, centre)
    return PoseDraw(
        1e3 * float(np.linalg.norm(away)),
        float(np.rad2deg(np.linalg.norm(error))),
        found.contains(T),
        compute_bound((np.array(felt) - centre) @ turn.T, np.array(normals), rng),
    )


def main() -> None:
    """Print a row for each patch."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--draws", type=int, default=200)
    options = parser.parse_args()
    mounted = MountedSkin(load_skin("ur5"), load_robot("ur5"))
    charts = build_charts(mounted)
    print(
        format_head(
            (
                *("patch", "shift error: median, 95 %", "within 1 mm"),
                *("rotation error: median, 95 %", "within 1°"),
                *("bound: median, within 1°", "in the 95 % region"),
            )
        )
    )
    for patch in PATCHES:
        first = mounted.skin.find_taxels(patch)[0]
        chart = next(each for each in charts if first in each.taxels)
        rng = np.random.default_rng(0)
        draws = [
            draw_estimate(mounted, patch, chart, number, rng)
            for number in range(options.draws)
        ]
        shift, turn, inside = (
            np.array([getattr(draw, name) for draw in draws])
            for name in ("shift", "turn", "contained")
        )
        bound = np.concatenate([draw.bound for draw in draws])
        print(
            format_row(
                (
                    f"`{patch}`",
                    f"{np.median(shift):.2f}, {np.percentile(shift, 95):.2f} mm",
                    f"{(shift <= 1).mean():.0%}",
                    f"{np.median(turn):.2f}, {np.percentile(turn, 95):.2f}°",
                    f"{(turn <= 1).mean():.0%}",
                    f"{np.median(bound):.2f}°, {(bound <= 1).mean():.0%}",
                    f"{inside.mean():.1%}",
                )
            ),
            flush=True,
        )


if __name__ == "__main__":
    main()
