"""Draw each gesture: pressure on the unrolled link over time, and force.

python -m lab.simulation.pictures docs/pictures
"""

from dataclasses import dataclass
from pathlib import Path

import matplotlib
import numpy as np
import tyro
from jaxtyping import Float
from matplotlib import pyplot
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection

from eskin.sim.contact.chart import Chart
from eskin.sim.dataset import ClipPlan, Simulator, get_build
from eskin.sim.dataset.clip import SimulatedClip, make_clip
from eskin.sim.dataset.plan import BuildOrigin, Origin
from eskin.touch import Calibration

GESTURES = ("poke", "double_pat", "grab", "stroke", "none")
KINDS = {
    "poke": "one_tip",
    "double_pat": "fingers",
    "grab": "full_hand",
    "stroke": "fingers",
    "none": "bump",
}
"""Most common kind of each gesture, and one accidental contact."""
FIRM = {"poke": 4.0, "double_pat": 7.0, "grab": 40.0, "stroke": 2.5, "none": 0.0}
"""Force that a typical clip exceeds: the median of each gesture [N]."""
LOOKS = 5
"""Number of instants that are shown."""
LINK = "forearm_link"
MM = 1e3


@dataclass(frozen=True)
class Command:
    """Draw one picture per gesture."""

    out: tyro.conf.Positional[Path]
    """Folder for the pictures."""


def main() -> None:
    """Draw the pictures."""
    matplotlib.use("Agg")
    command = tyro.cli(Command)
    simulator = Simulator()
    for gesture in GESTURES:
        clip, plan = typical(simulator, gesture)
        figure = draw(simulator, clip, plan)
        figure.savefig(command.out / f"gesture_{gesture}.png", dpi=90)
        pyplot.close(figure)


def typical(simulator: Simulator, gesture: str) -> tuple[SimulatedClip, ClipPlan]:
    """Find the first whole clip of a gesture on the forearm with typical force."""
    for number in range(400):
        plan = plan_clip(gesture, number)
        clip = make_clip(plan, simulator.env)
        for truth in clip.truths[:1]:
            whole = truth.onset > 0.1 and truth.end < plan.seconds - 0.1
            firm = truth.force.max() > FIRM[gesture]
            if whole and firm and truth.link == LINK and len(clip.truths) == 1:
                return clip, plan
    raise RuntimeError(f"no whole {gesture} on {LINK} in 400 clips")


def plan_clip(gesture: str, number: int) -> ClipPlan:
    """Plan an easy clip: a fresh build, and a robot that stands still."""
    return ClipPlan(
        set_name="picture",
        seed=(7, number),
        person=Origin("picture", (7, 1000 + number)),
        company=None,
        build=BuildOrigin("picture", (7, 1), "fresh"),
        session=Origin("picture", (7, 2)),
        at=0.0,
        seconds=2.0,
        gesture=gesture,
        kind=KINDS.get(gesture),
        groups=(1, 2, 3, 4, 5, 6, 7, 8),
        pose=None,
        moving=False,
        fold_share=0.0,
        concurrent=0.0,
        difficulty=0.0,
        regime="paper",
    )


def calibrate(
    clip: SimulatedClip, calibration: Calibration
) -> Float[np.ndarray, "reading taxel"]:
    """Return the calibrated pressure [kPa]; rest is the median of the counts."""
    above = clip.counts - np.median(clip.counts, axis=0)
    return np.where(clip.received, calibration.compute_pressure(above), 0.0)


def draw(simulator: Simulator, clip: SimulatedClip, plan: ClipPlan) -> pyplot.Figure:
    """Draw the unrolled link at several instants, then the force over time."""
    truth = clip.truths[0]
    build = get_build(plan.build, simulator.env)
    pressure = calibrate(clip, build.calibration(simulator.mounted.skin))
    charts = [chart for chart in simulator.env.charts if chart.link == LINK]
    chart = max(charts, key=lambda chart: len(chart.taxels))
    seen = pressure[:, chart.taxels]
    pressed = np.flatnonzero(truth.force > 0)
    last = max(pressed[-1], pressed[0] + LOOKS - 1)
    looks = np.linspace(pressed[0], last, LOOKS).round().astype(int)
    figure, axes = pyplot.subplots(
        *(1, LOOKS + 1), figsize=(13, 2.9), width_ratios=[1] * LOOKS + [1.3],
        layout="constrained",
    )  # fmt: skip
    high = max(float(seen[looks].max()), 5.0)
    corners = MM * compute_corners(chart)
    window = compute_window(chart, seen)
    for axis, look in zip(axes, looks, strict=False):
        cells = PolyCollection(corners, array=seen[look], edgecolor="0.5", lw=0.2)
        cells.set_clim(0, high)
        axis.add_collection(cells)
        axis.set(title=f"{look * 0.02:.2f} s", xlabel="around [mm]", aspect="equal")
        axis.set(xlim=window[:, 0], ylim=window[:, 1])
    axes[0].set_ylabel("along the forearm [mm]")
    for axis in axes[1:LOOKS]:
        axis.set_yticklabels([])
    figure.colorbar(cells, ax=axes[:LOOKS], label="read [kPa]")
    draw_force(axes[-1], truth.force, pressure, simulator.mounted.skin.areas)
    figure.suptitle(f"{truth.gesture} ({truth.kind})")
    return figure


def compute_corners(chart: Chart) -> Float[np.ndarray, "part 4 2"]:
    """Return the corners of the taxels' cells, unrolled [m]."""
    signs = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return chart.unrolled[:, None] + np.einsum("ci,tij->tcj", signs, chart.cells)


def compute_window(
    chart: Chart, seen: Float[np.ndarray, "reading part"]
) -> Float[np.ndarray, "2 2"]:
    """Return the least and greatest (s, t) of the window about the touch [mm]."""
    touched = chart.unrolled[seen.max(axis=0) >= 2.0]
    middle = MM * (touched.min(axis=0) + touched.max(axis=0)) / 2
    half = max(45.0, MM * float(np.ptp(touched, axis=0).max()) / 2 + 12.0)
    return np.array([middle - half, middle + half])


def draw_force(
    axis: Axes,
    force: Float[np.ndarray, "reading"],
    pressure: Float[np.ndarray, "reading taxel"],
    areas: Float[np.ndarray, "taxel"],
) -> None:
    """Draw the true force, and that of the taxels that read 3 kPa or more."""
    times = 0.02 * np.arange(len(force))
    read = np.where(pressure >= 3.0, pressure, 0.0) @ (areas * 1e3)
    axis.plot(times, force, label="true")
    axis.plot(times, read, label="read")
    axis.set_xlabel("s")
    axis.set_ylabel("N")
    axis.legend()


if __name__ == "__main__":
    main()
