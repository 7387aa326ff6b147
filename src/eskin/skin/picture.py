"""A picture of a skin: its patches rolled flat, and the robot that wears it."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from eskin.files import atomic_path
from eskin.robot import Robot
from eskin.skin.fit import fit_surface
from eskin.skin.mount import MountedSkin
from eskin.skin.render import draw_robot
from eskin.skin.skin import Skin

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

__all__ = ["draw_skin"]

COLOURS = (
    *("#3b6fb6", "#e08a2e", "#4a9b5c", "#c94f4f", "#8a63b8", "#8c6a4f"),
    *("#d77fb4", "#2fa3a8", "#b3a22f", "#5f6f86", "#7fb34a", "#a8456e"),
)
VIEWS = ((-60.0, 18.0), (120.0, 18.0))
SPACE = 0.02
LABEL = 0.075
BAR = 0.05


def draw_skin(
    skin: Skin,
    path: str | Path,
    robot: Robot | None = None,
    q: Float[np.ndarray, "joint"] | None = None,
) -> None:
    """Draw a skin into a picture file.

    Args:
        skin: the skin.
        path: where to; the ending says which format.
        robot: what wears it; without one only the rolled-out patches are drawn.
        q: the robot's pose [rad]; zero, as near as its limits allow, where None.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    path = Path(path)
    if not path.parent.is_dir():
        raise ValueError(f"no folder {path.parent} for {path.name}; make it first")
    figure = Figure(figsize=(15.0, 9.0) if robot else (9.0, 9.0), layout="constrained")
    canvas = FigureCanvasAgg(figure)
    formats = canvas.get_supported_filetypes()
    if path.suffix.lstrip(".").lower() not in formats:
        raise ValueError(
            f"no picture format '{path.suffix}' for {path}; allowed: "
            f"{', '.join('.' + name for name in sorted(formats))}"
        )
    colours = [COLOURS[i % len(COLOURS)] for i in range(len(skin.patches))]
    flat, views = lay_panels(figure, robot is not None)
    draw_unrolled(flat, skin, colours)
    if robot is not None:
        mounted = MountedSkin(skin, robot)
        pose = np.clip(0.0, robot.lower, robot.upper) if q is None else q
        for panel, view in zip(views, VIEWS, strict=True):
            draw_robot(panel, mounted, pose, colours, view)
    area = 1e4 * skin.areas.sum()
    figure.suptitle(
        f"{skin.name}: {skin.count} taxels, patches: {len(skin.patches)}, "
        f"{area:.0f} cm², {skin.count / area:.2f} taxels/cm²"
        + ("" if skin.calibrated else " (nominal geometry)")
    )
    with atomic_path(path) as part:
        figure.savefig(part, dpi=110)


def lay_panels(figure: "Figure", has_views: bool) -> tuple["Axes", list["Axes"]]:
    """The panel for the patches, and the panels for the views if there are any."""
    if not has_views:
        return figure.subplots(), []
    grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1.0))
    return figure.add_subplot(grid[:, 0]), [
        figure.add_subplot(grid[row, 1]) for row in range(2)
    ]


def draw_unrolled(panel: "Axes", skin: Skin, colours: list[str]) -> None:
    """Draw every patch rolled flat, all to one scale, on shelves from the top."""
    from matplotlib.collections import PolyCollection

    left, top, low = 0.0, 0.0, 0.0
    for number, patch in enumerate(skin.patches):
        taxels = np.flatnonzero(skin.patch_index == number)
        if len(taxels) == 0:
            continue
        squares = unrolled_squares(skin, taxels)
        size = np.ptp(squares.reshape(-1, 2), axis=0)
        if left > 0 and left + size[0] > shelf_width(skin):
            left, top = 0.0, low - 3 * SPACE
        corner = squares.reshape(-1, 2).min(axis=0)
        squares = squares - corner + [left, top - size[1]]
        panel.add_collection(
            PolyCollection(
                list(squares), facecolors=colours[number], linewidths=0, snap=False
            )
        )
        density = len(taxels) / (1e4 * skin.areas[taxels].sum())
        label = f"{patch.id}\n{len(taxels)}, {density:.2f}/cm²"
        panel.text(left, top + 0.2 * SPACE, label, fontsize=8, va="bottom")
        left, low = left + max(size[0], LABEL) + SPACE, min(low, top - size[1])
    panel.plot([0, BAR], [low - SPACE] * 2, color="black", linewidth=2)
    panel.text(BAR + 0.005, low - SPACE, f"{1e3 * BAR:.0f} mm", va="center", fontsize=8)
    panel.set_aspect("equal")
    panel.margins(0.02)
    panel.axis("off")


def shelf_width(skin: Skin) -> float:
    """A width [m] that sets the patches out about as wide as they are high."""
    return float(max(1.45 * np.sqrt(skin.areas.sum()), 0.1))


def unrolled_squares(skin: Skin, taxels: np.ndarray) -> Float[np.ndarray, "part 4 2"]:
    """A square of each taxel's area, rolled flat where the patch lies on a surface."""
    surface = fit_surface(skin.positions[taxels], skin.normals[taxels])
    side = np.sqrt(skin.areas[taxels])
    if surface is not None:
        centres = surface.unroll(skin.positions[taxels])
    else:
        cells = np.column_stack([skin.columns[taxels], skin.rows[taxels]])
        centres = cells * side.mean()
    corners = 0.44 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    return centres[:, None] + side[:, None, None] * corners
