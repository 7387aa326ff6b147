"""This module writes a design: the skin, its drawings, its tables and its report."""

import csv
import json
from io import StringIO
from pathlib import Path

from eskin.design.design import SkinDesign
from eskin.design.drawing import (
    PatchDrawing,
    arrange_sheet,
    draw_patch,
    save_dxf,
    save_svg,
)
from eskin.design.maps import save_map
from eskin.design.report import build_report
from eskin.files import atomic_path
from eskin.skin import save_skin

COLUMNS = (
    *("taxel", "row", "column", "s_mm", "t_mm"),
    *("x_mm", "y_mm", "z_mm", "nx", "ny", "nz", "area_mm2"),
)
"""Columns of the table of a patch: place in the drawing, then on the link."""


def save_design(design: SkinDesign, folder: Path) -> dict[str, object]:
    """Write a design into a folder, and return its report.

    The folder is that of the skin, which `load_skin` reads. Beside the skin it holds
    `patches/` with a DXF, an SVG, a table of coordinates and the map to the link of
    each patch, `sheet.svg` and `sheet.dxf` with all patches, and `report.json`.
    """
    drawings = draw_design(design)
    report = build_report(design, drawings)
    patches = folder / "patches"
    for number, drawing in enumerate(drawings):
        save_dxf(patches / f"{drawing.name}.dxf", [drawing])
        save_svg(patches / f"{drawing.name}.svg", [drawing])
        with atomic_path(patches / f"{drawing.name}.csv") as part:
            text = format_table(design, number)
            part.write_text(text, encoding="utf-8", newline="\n")
        link = design.skin.patches[number].link
        save_map(patches / f"{drawing.name}.map.json", link, design.layouts[number])
    sheet = arrange_sheet(drawings)
    save_svg(folder / "sheet.svg", sheet)
    save_dxf(folder / "sheet.dxf", sheet)
    with atomic_path(folder / "report.json") as part:
        part.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")
    save_skin(design.skin, folder)
    return report


def draw_design(design: SkinDesign) -> list[PatchDrawing]:
    """Draw every patch of a design."""
    return [
        draw_patch(patch.id, layout)
        for patch, layout in zip(design.skin.patches, design.layouts, strict=True)
    ]


def format_table(design: SkinDesign, number: int) -> str:
    """Return the table of coordinates of one patch, as CSV."""
    skin = design.skin
    taxels = skin.find_taxels(skin.patches[number].id).tolist()
    flat = 1e3 * design.layouts[number].grid.unrolled()
    out = StringIO()
    write = csv.writer(out, lineterminator="\n").writerow
    write(COLUMNS)
    for (s, t), taxel in zip(flat.tolist(), taxels, strict=True):
        place = [*(1e3 * skin.positions[taxel]), *skin.normals[taxel]]
        write(
            [
                *(taxel, skin.rows[taxel], skin.columns[taxel]),
                *(f"{value:.6f}" for value in (s, t, *place)),
                f"{1e6 * skin.areas[taxel]:.4f}",
            ]
        )
    return out.getvalue()
