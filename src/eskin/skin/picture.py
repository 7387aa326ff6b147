"""This module draws the unrolled patches of a skin, and a robot that wears it."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from eskin.files import atomic_path
from eskin.robot import Kinematics, Robot, build_geom_mesh
from eskin.skin.skin import MountedSkin, Skin
from eskin.skin.surfaces import fit_surface
from eskin.transforms import apply
from eskin.units import format_count

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PICTURE_SUFFIXES = (".png", ".svg", ".pdf")
"""Ends of the names of pictures that can be drawn, in any case."""

# Unrolled patches with their captions.
COLOURS = (
    "#3b6fb6 #e08a2e #4a9b5c #c94f4f #8a63b8 #8c6a4f "
    "#d77fb4 #2fa3a8 #b3a22f #5f6f86 #7fb34a #a8456e"
).split()
SPACE = 0.12
"""Distance between unrolled patches in a picture [in]."""
FONT_SIZE = 8
"""Size of the letters of captions [pt]."""
LETTER = 0.6 * FONT_SIZE / 72
"""Mean width of a letter of a caption, with some room [in]."""
CAPTION = 3.0 * FONT_SIZE / 72
"""Height of a caption of two lines, with some room [in]."""
MAX_LABELS = 24
"""Number of patches up to which they have labels."""
UNROLLED_WIDTH = 6.0
"""Usual width of the unrolled patches in a picture [in]."""
MAX_HEIGHT = 8.0
"""Greatest height of a picture of values [in]."""
SCALE_WIDTH = 1.0
"""Width of the scale of values beside them [in]."""
BARS = (0.05, 0.01)
"""Length of the scale bar, and of the bar of a skin too small for it [m]."""

# Views of the robot.
VIEWS = ((-60.0, 18.0), (120.0, 18.0))
"""Azimuth and elevation of the camera in each view of the robot [deg]."""
ROBOT_COLOUR = "#d8dade"
SKIN_LIFT = 0.9
"""Distance by which taxels are drawn in front of the robot's surface, in taxels."""
MAX_EDGE = 0.02
EDGE_TAXELS = 2.0
"""Largest edge of the triangles of which the robot is drawn [m], and in taxels."""
MARGIN = 0.25
"""Width of the robot that is drawn around the skin [m]."""
CORNERS = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
"""Corners of a square of side 2."""
MAX_PIECES = 150
"""Largest number of small triangles along a robot."""


def check_picture_format(path: Path) -> None:
    """Raise a ValueError if the name of a file ends as no picture that can be drawn."""
    if path.suffix.lower() not in PICTURE_SUFFIXES:
        raise ValueError(
            f"{path} is no picture that can be drawn; allowed are "
            f"{', '.join(PICTURE_SUFFIXES)}"
        )


def draw_skin(
    skin: Skin,
    path: str | Path,
    robot: Robot | None = None,
    q: Float[np.ndarray, "joint"] | None = None,
) -> None:
    """Draw a skin into an image file, with a colour for each patch.

    Fig. 7a of Jiang et al. 2025 shows theirs.

    Args:
        skin: the skin.
        path: the file, whose suffix gives the format.
        robot: the robot with the skin; without one only the unrolled patches are drawn.
        q: joint values [rad]; None for zero, clipped to the joint limits.

    Raises:
        ValueError: The folder does not exist, or the format is unknown.
    """
    from matplotlib.figure import Figure

    path = Path(path)
    check_picture_format(path)
    if not path.parent.is_dir():
        raise ValueError(f"no folder {path.parent} for {path.name}; make it first")
    height = 9.0 if robot is None or len(skin.patches) <= MAX_LABELS else 7.5
    figure = Figure(figsize=(15.0 if robot else 9.0, height), layout="constrained")
    colours = [COLOURS[i % len(COLOURS)] for i in range(len(skin.patches))]
    if robot is None:
        draw_unrolled(figure.subplots(), skin, colours)
    else:
        if len(skin.patches) > MAX_LABELS:
            # Patches without labels are small: the robot is what is looked at.
            flat, *views = figure.subplots(1, 3, width_ratios=(0.8, 1.0, 1.0))
        else:
            grid = figure.add_gridspec(2, 2, width_ratios=(1.2, 1.0))
            flat = figure.add_subplot(grid[:, 0])
            views = [figure.add_subplot(grid[row, 1]) for row in (0, 1)]
        draw_unrolled(flat, skin, colours)
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


def draw_values(skin: Skin, values: Float[np.ndarray, "taxel"], unit: str) -> "Figure":
    """Draw a value of each taxel on the unrolled patches, with a scale.

    Raises:
        ValueError: There is not one value a taxel.
    """
    from matplotlib import colormaps
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    if values.shape != (skin.count,):
        raise ValueError(
            f"values have shape {values.shape}, skin '{skin.name}' has {skin.count} "
            "taxels; allowed is a value a taxel; give those of one reading"
        )
    figure = Figure(layout="constrained")
    scale = Normalize(min(np.nanmin(values), 0.0), max(np.nanmax(values), 1e-9))
    shown = ScalarMappable(scale, colormaps["viridis"])
    panel = figure.subplots()
    width, height = draw_unrolled(panel, skin, shown.to_rgba(values))
    drawn = min(UNROLLED_WIDTH / width, MAX_HEIGHT / height)
    figure.set_size_inches(width * drawn + SCALE_WIDTH, height * drawn)
    figure.colorbar(shown, ax=panel, label=unit, shrink=0.8)
    return figure


def draw_unrolled(
    panel: "Axes", skin: Skin, colours: "list[str] | Float[np.ndarray, 'taxel 4']"
) -> tuple[float, float]:
    """Draw all unrolled patches to one scale, in rows from the top.

    Captions keep their size in inches, so that those of small patches take room too.

    Args:
        panel: where they are drawn.
        skin: the skin.
        colours: a colour of each patch, or of each taxel.

    Returns:
        Width and height of the drawing [m].
    """
    from matplotlib.collections import PolyCollection

    # With rows of this width the drawing is about square.
    labelled = len(skin.patches) <= MAX_LABELS
    row_width = (1.45 if labelled else 1.2) * np.sqrt(skin.areas.sum())
    inch = max(row_width, *measure_patches(skin)) / UNROLLED_WIDTH
    space = SPACE * inch
    caption = CAPTION * inch if labelled else 0.0
    length = BARS[0] if row_width > 2 * BARS[0] else BARS[1]
    left = 0.0
    top = 0.0
    low = 0.0
    right = length + 10 * LETTER * inch
    for number, patch in enumerate(skin.patches):
        taxels = np.flatnonzero(skin.patch_index == number)
        if len(taxels) == 0:
            continue
        squares = build_unrolled_squares(skin, taxels)
        corner = squares.reshape(-1, 2).min(axis=0)
        size = np.ptp(squares.reshape(-1, 2), axis=0)
        density = len(taxels) / (1e4 * skin.areas[taxels].sum())
        lines = (
            patch.id,
            f"{format_count(len(taxels), 'taxel')}, {density:.2f}/cm²",
        )
        width = float(size[0])
        if labelled:
            width = max(width, max(map(len, lines)) * LETTER * inch)
        if left > 0 and left + width > row_width:
            left = 0.0
            top = low - space - caption
        squares = squares - corner + [left, top - size[1]]
        own = colours[number] if isinstance(colours, list) else colours[taxels]
        panel.add_collection(
            PolyCollection(list(squares), facecolors=own, linewidths=0, snap=False)
        )
        if labelled:
            text = "\n".join(lines)
            panel.text(left, top + 0.3 * space, text, fontsize=FONT_SIZE, va="bottom")
        right = max(right, left + width)
        low = min(low, top - size[1])
        left += width + space
    bar = low - 2 * space
    panel.plot([0, length], [bar, bar], color="black", linewidth=2)
    panel.text(
        length + 0.3 * space,
        bar,
        f"{1e3 * length:.0f} mm",
        va="center",
        fontsize=FONT_SIZE,
    )
    panel.set_aspect("equal")
    panel.set_xlim(-space, right + space)
    panel.set_ylim(bar - space, caption + space)
    panel.axis("off")
    return right + 2 * space, caption - bar + 2 * space


def measure_patches(skin: Skin) -> list[float]:
    """Return the width of each unrolled patch that has taxels [m]."""
    taxels = (np.flatnonzero(skin.patch_index == n) for n in range(len(skin.patches)))
    return [
        float(np.ptp(build_unrolled_squares(skin, own)[..., 0]))
        for own in taxels
        if len(own)
    ]


def build_unrolled_squares(
    skin: Skin, taxels: np.ndarray
) -> Float[np.ndarray, "part 4 2"]:
    """Build a square of each taxel's area, unrolled where the patch fits a surface."""
    surface = fit_surface(skin.positions[taxels], skin.normals[taxels])
    side = np.sqrt(skin.areas[taxels])
    if surface is not None:
        centres = surface.unroll(skin.positions[taxels])
    else:
        cells = np.column_stack([skin.columns[taxels], skin.rows[taxels]])
        centres = cells * side.mean()
    return centres[:, None] + side[:, None, None] * (0.44 * CORNERS)


def draw_robot(
    panel: "Axes",
    mounted: MountedSkin,
    q: Float[np.ndarray, "joint"],
    colours: list[str],
    view: tuple[float, float],
) -> None:
    """Draw the robot at q, seen from an azimuth and elevation [deg].

    Taxels have the colours of their patches.
    """
    from matplotlib.collections import PolyCollection
    from matplotlib.colors import to_rgb

    camera = build_camera_rotation(*view)
    taxel = float(np.sqrt(np.median(mounted.skin.areas)))
    max_edge = min(EDGE_TAXELS * taxel, MAX_EDGE)
    triangles = build_robot_triangles(mounted.robot, q, max_edge)
    quads = build_taxel_quads(mounted, q)
    robot_colours = np.tile(to_rgb(ROBOT_COLOUR), (len(triangles), 1))
    patch_colours = np.array([to_rgb(colour) for colour in colours])
    skin_colours = patch_colours[mounted.skin.patch_index]
    drawn = [
        *shade_polygons(triangles, robot_colours, camera, 0.0),
        *shade_polygons(quads, skin_colours, camera, SKIN_LIFT * taxel),
    ]
    drawn.sort(key=lambda item: item[0])
    panel.add_collection(
        PolyCollection(
            [polygon for _, polygon, _ in drawn],
            facecolors=[colour for _, _, colour in drawn],
            edgecolors=[colour for _, _, colour in drawn],
            linewidths=0.2,
            snap=False,
        )
    )
    seen = np.array([corner for _, polygon, _ in drawn for corner in polygon])
    near = quads.reshape(-1, 3) @ camera[:2].T
    low = np.maximum(seen.min(axis=0), near.min(axis=0) - MARGIN)
    high = np.minimum(seen.max(axis=0), near.max(axis=0) + MARGIN)
    panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    panel.axis("off")


def build_camera_rotation(azimuth: float, elevation: float) -> Float[np.ndarray, "3 3"]:
    """Build the rotation with rows right, up and toward the camera."""
    a, e = np.deg2rad([azimuth, elevation])
    toward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    right = np.array([-np.sin(a), np.cos(a), 0.0])
    return np.stack([right, np.cross(toward, right), toward])


def build_robot_triangles(
    robot: Robot, q: Float[np.ndarray, "joint"], max_edge: float
) -> Float[np.ndarray, "face 3 3"]:
    """Build small triangles of the surfaces of all geoms, in the world."""
    parts = [np.zeros((0, 3, 3))]
    for T_world_link, link in zip(Kinematics(robot).poses(q), robot.links, strict=True):
        for mesh in map(build_geom_mesh, link.geoms):
            parts.append(apply(T_world_link, mesh.vertices)[mesh.faces])
    triangles = np.concatenate(parts)
    if len(triangles):
        size = np.ptp(triangles.reshape(-1, 3), axis=0).max()
        max_edge = max(max_edge, float(size) / MAX_PIECES)
    return subdivide(triangles, max_edge)


def subdivide(
    triangles: Float[np.ndarray, "face 3 3"], max_edge: float
) -> Float[np.ndarray, "piece 3 3"]:
    """Halve triangles at their longest edge until all edges are short [m].

    Sorting polygons by the depth of their centres needs small ones.
    """
    done = [triangles[:0]]
    while len(triangles):
        edges = np.linalg.norm(np.roll(triangles, -1, axis=1) - triangles, axis=2)
        longest = np.argmax(edges, axis=1)
        long = edges.max(axis=1) > max_edge
        done.append(triangles[~long])
        triangles = triangles[long]
        longest = longest[long]
        each = np.arange(len(triangles))
        a, b, c = (triangles[each, (longest + step) % 3] for step in range(3))
        middle = (a + b) / 2
        triangles = np.concatenate(
            [np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)]
        )
    return np.concatenate(done)


def build_taxel_quads(
    mounted: MountedSkin, q: Float[np.ndarray, "joint"]
) -> Float[np.ndarray, "taxel 4 3"]:
    """Build a square of each taxel's area, in the world."""
    p_world, _ = mounted.place_taxels(q)
    x_axis, y_axis, _ = np.moveaxis(mounted.compute_frames(q), -1, 0)
    side = np.sqrt(mounted.skin.areas)[:, None, None]
    x, y = 0.46 * CORNERS.T[:, :, None]
    return p_world[:, None] + side * (x * x_axis[:, None] + y * y_axis[:, None])


def shade_polygons(
    polygons: Float[np.ndarray, "face corner 3"],
    colours: Float[np.ndarray, "face 3"],
    camera: Float[np.ndarray, "3 3"],
    lift: float,
) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Return depth, projection and colour of the polygons that face the camera."""
    normals = np.cross(polygons[:, 1] - polygons[:, 0], polygons[:, 2] - polygons[:, 0])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-300)
    facing = normals @ camera[2]
    light = 0.55 + 0.45 * np.clip(normals @ (camera.T @ [-0.35, 0.6, 0.72]), 0.0, 1.0)
    seen = polygons @ camera.T
    depth = seen[..., 2].mean(axis=1) + lift
    return [
        (depth[i], seen[i, :, :2], colours[i] * light[i])
        for i in np.flatnonzero(facing > 0.02)
    ]
