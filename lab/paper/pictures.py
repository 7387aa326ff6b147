"""This module draws the pictures of docs/paper.md.

    python -m lab.paper.pictures edges --out docs/pictures/paper_edges.png
    python -m lab.paper.pictures labels --sets SETS --out docs/pictures/paper_labels.png

The first is after the paper's Fig. 8, the second after its Fig. 10. Fig. 11 is drawn by
`python -m lab.paper fig11 --picture FILE`.
"""

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
import tyro
from eskin_paper_network.neighbours import Neighbourhood
from jaxtyping import Bool, Float, Int
from matplotlib.figure import Figure

from eskin.labelling.autolabel import compute_peak_pressures, label_recording
from eskin.learn.plots import save_figure
from eskin.recording import read_recording
from eskin.robot import load_robot
from eskin.skin import MountedSkin, load_skin
from eskin.units import NS_PER_S
from lab.paper.trials import POOLINGS, Answers, compute_accuracy, name_cell
from lab.program import run_program
from lab.simulated_sets import made_set

FOLDED = (-0.98, -0.44, 2.93, 0.39, -1.52, -1.62)
"""Joint positions of a UR5 whose wrist 3 lies against its upper arm [rad]."""
TOUCHED_WITHIN = 0.05
"""Radius of the touch that is drawn [m]."""
VIEW = 0.24
"""Half of the width of the view [m]."""
SHOWN = 60.0
"""Length of the trace that is drawn [s]."""
LONGEST_GAP = 0.5
"""Time between two readings above which the trace is interrupted [s]."""
COLOURS = {"max": "tab:blue", "mean": "tab:orange"}
GESTURE_COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:red")


def draw_neighbours(answers: Answers, neighbours: Sequence[int], path: Path) -> None:
    """Draw accuracy by the number of neighbours for both poolings, as Fig. 11."""
    figure = Figure(figsize=(8.4, 3.4), dpi=120, layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    titles = {"val": "validation, a person held out", "test": "test, another day"}
    for axes, (test, title) in zip(panels, titles.items(), strict=True):
        for pooling in POOLINGS:
            points = [
                (k, found)
                for k in neighbours
                if (
                    found := compute_accuracy(
                        answers, "paper", name_cell(k, pooling), test
                    )
                )
            ]
            if not points:
                continue
            means = np.array([100 * found.mean for _, found in points])
            lows = np.array([100 * found.low for _, found in points])
            highs = np.array([100 * found.high for _, found in points])
            axes.errorbar(
                [k for k, _ in points],
                means,
                [means - lows, highs - means],
                marker="o",
                capsize=3,
                color=COLOURS[pooling],
                label=f"{pooling} pooling",
            )
        axes.set_xscale("log", base=2)
        axes.set_xticks(list(neighbours), [str(k) for k in neighbours])
        axes.set(title=title, xlabel="K")
        axes.axhline(25, color="gray", linestyle=":")
        axes.grid(alpha=0.3)
    panels[0].set(ylabel="accuracy (%)", ylim=(0, 100))
    panels[0].legend(loc="lower right", frameon=False)
    save_figure(figure, path)


def draw_edges(path: Path) -> None:
    """Draw fixed edges of the skin and live ones of a touch in two poses (Fig. 8)."""
    mounted = MountedSkin(load_skin("ur5"), load_robot("ur5"))
    near = Neighbourhood(mounted, 8, "kinematic")
    fixed = np.argwhere(near.table >= 0)
    fixed = np.stack([fixed[:, 0], near.table[near.table >= 0]], axis=1)
    touched = find_touch_across_links(near)
    figure = Figure(figsize=(9.0, 4.2), dpi=120, layout="constrained")
    figure.suptitle("The same taxels are touched in two poses", fontsize="medium")
    poses = {"stretched": np.zeros(len(FOLDED)), "folded": np.array(FOLDED)}
    for number, (name, q) in enumerate(poses.items(), 1):
        axes: Any = figure.add_subplot(1, 2, number, projection="3d")
        p_world, _ = mounted.place_taxels(q)
        live = near.find_live_edges(touched[None], q[None])[0]
        pairs = np.argwhere(live >= 0)
        ends = np.stack([pairs[:, 0], live[live >= 0]], axis=1)
        draw_lines(axes, p_world, fixed, "0.75", 0.3)
        axes.plot(*p_world[touched].T, "o", color="tab:blue", markersize=2)
        draw_lines(axes, p_world, ends, "tab:red", 1.2)
        middle = p_world[touched].mean(axis=0)
        axes.set_title(f"arm {name}: {len(ends)} live edges")
        axes.set_xlim(middle[0] - VIEW, middle[0] + VIEW)
        axes.set_ylim(middle[1] - VIEW, middle[1] + VIEW)
        axes.set_zlim(middle[2] - VIEW, middle[2] + VIEW)
        axes.set_box_aspect((1, 1, 1), zoom=1.6)
        axes.view_init(elev=20, azim=30)
        axes.set_axis_off()
    save_figure(figure, path)


def find_touch_across_links(near: Neighbourhood) -> Bool[np.ndarray, "taxel"]:
    """Return the taxels round the place where two links of the folded arm meet."""
    q = np.array(FOLDED)
    p_world, _ = near.mounted.place_taxels(q)
    every = np.ones((1, len(p_world)), bool)
    live = near.find_live_edges(every, q[None])[0]
    links = near.mounted.taxel_link_index
    across = (live >= 0) & (links[live] != links[:, None])
    centre = p_world[np.argmax(across.sum(axis=1))]
    return np.linalg.norm(p_world - centre, axis=1) < TOUCHED_WITHIN


def draw_lines(
    axes: Any,  # noqa: ANN401
    points: Float[np.ndarray, "taxel 3"],
    ends: Int[np.ndarray, "edge 2"],
    colour: str,
    width: float,
) -> None:
    """Draw lines between pairs of points, in one path."""
    gap = np.full((len(ends), 1, 3), np.nan)
    path = np.concatenate([points[ends], gap], axis=1).reshape(-1, 3)
    axes.plot(*path.T, color=colour, linewidth=width)


def draw_labels(sets: Path, path: Path) -> None:
    """Draw the largest pressure of a recording and its automatic labels (Fig. 10)."""
    folder = made_set(sets, "paper", clips=33, people=3) / "train"
    recording = read_recording(min(folder.glob("*.mcap")))
    stamps, peaks = compute_peak_pressures(recording)
    found = label_recording(recording).found
    times = (stamps - stamps[0]) / NS_PER_S
    # A set holds no readings between its clips.
    gaps = np.flatnonzero(np.diff(times) > LONGEST_GAP) + 1
    times = np.insert(times, gaps, np.nan)
    peaks = np.insert(peaks, gaps, np.nan)
    figure = Figure(figsize=(9.0, 3.0), dpi=120, layout="constrained")
    axes = figure.add_subplot()
    axes.plot(times, peaks, color="black", linewidth=0.8)
    gestures = sorted({label.gesture for label in found})
    colours = dict(zip(gestures, GESTURE_COLOURS, strict=False))
    for label in found:
        first = (label.start - stamps[0]) / NS_PER_S
        last = (label.end - stamps[0]) / NS_PER_S
        if first < SHOWN:
            axes.axvspan(first, last, color=colours[label.gesture], alpha=0.35)
    for gesture, colour in colours.items():
        axes.axvspan(0, 0, color=colour, alpha=0.35, label=gesture)
    axes.set(xlim=(0, SHOWN), xlabel="time (s)", ylabel="largest pressure (kPa)")
    axes.legend(loc="upper right", ncols=5, frameon=False)
    save_figure(figure, path)


@dataclass(frozen=True)
class PictureCommand:
    """Draw a picture of docs/paper.md."""

    kind: tyro.conf.Positional[Literal["edges", "labels"]]
    """Fixed and live edges on the arm, or a trace with automatic labels."""

    out: Path
    """File to write."""

    sets: Path = Path("sets")
    """Folder of the sets."""


def draw(command: PictureCommand) -> dict[str, object]:
    """Draw a picture."""
    if command.kind == "edges":
        draw_edges(command.out)
    else:
        draw_labels(command.sets, command.out)
    return {"out": str(command.out)}


if __name__ == "__main__":
    sys.exit(run_program(draw))
