"""This module writes a design: the skin, its drawings, its tables and its report."""

import csv
import json
from collections.abc import Sequence
from io import StringIO
from math import ceil
from pathlib import Path

import numpy as np

from eskin.design.design import SkinDesign
from eskin.design.drawing import (
    PatchDrawing,
    arrange_sheet,
    draw_patch,
    save_dxf,
    save_svg,
)
from eskin.design.maps import save_map
from eskin.design.spec import PER_CM2
from eskin.drivers.packet import CRC, DATA_BODY, HEADER, MAX_COUNTS
from eskin.files import atomic_path
from eskin.progress import track_progress
from eskin.robot import Robot
from eskin.skin import save_skin

COLUMNS = (
    "taxel",
    "row",
    "column",
    "s_mm",
    "t_mm",
    "x_mm",
    "y_mm",
    "z_mm",
    "nx",
    "ny",
    "nz",
    "area_mm2",
)
"""Columns of the table of a patch: place in the drawing, then on the link."""


def save_design(
    design: SkinDesign, folder: Path, robot: Robot | None = None
) -> dict[str, object]:
    """Write a design into a folder, and return its report.

    The folder is that of the skin, which `load_skin` reads. Beside the skin it holds
    `patches/` with a DXF, an SVG, a table of coordinates and the map to the link of
    each patch, `sheet.svg` and `sheet.dxf` with all patches, and `report.json`. The
    URDF of the robot is copied into it, where one is given.
    """
    drawings = draw_design(design)
    report = build_report(design, drawings)
    patches = folder / "patches"
    named = enumerate(drawings)
    for number, drawing in track_progress(named, "patches drawn", len(drawings)):
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
    save_skin(design.skin, folder, robot)
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
                taxel,
                skin.rows[taxel],
                skin.columns[taxel],
                *(f"{value:.6f}" for value in (s, t, *place)),
                f"{1e6 * skin.areas[taxel]:.4f}",
            ]
        )
    return out.getvalue()


BYTES_PER_COUNT = 2
BITS_PER_BYTE = 8


def build_report(
    design: SkinDesign, drawings: Sequence[PatchDrawing]
) -> dict[str, object]:
    """Build the report of a design, as plain data.

    Args:
        design: the design.
        drawings: drawings of its patches, in order.
    """
    skin = design.skin
    covered = PER_CM2 * float(skin.areas.sum())
    allowed = PER_CM2 * sum(result.allowed_area for result in design.regions)
    area = PER_CM2 * sum(result.area for result in design.regions)
    counts = np.bincount(skin.patch_index, minlength=len(skin.patches))
    close = np.bincount(skin.patch_index[design.close], minlength=len(skin.patches))
    return {
        "name": skin.name,
        "taxels": skin.count,
        "boards": len(skin.patches),
        "area_cm2": round(area, 1),
        "allowed_cm2": round(allowed, 1),
        "covered_cm2": round(covered, 1),
        "coverage": round(covered / area, 4),
        "coverage_of_allowed": round(covered / allowed, 4),
        "density_per_cm2": round(skin.count / covered, 4),
        "distortion_max": round(max(p.distortion for p in design.layouts), 4),
        "wiring_m": round(1e-3 * sum(d.trace_length for d in drawings), 2),
        "trace_pitch_mm": round(min(d.trace_pitch for d in drawings), 4),
        "bandwidth_mbit_s": round(
            1e-6 * design.spec.limits.rate * sum(map(count_scan_bits, counts.tolist())),
            3,
        ),
        "rate_hz": design.spec.limits.rate,
        "combined_poses": design.spec.limits.poses,
        "taxels_close": int(design.close.sum()),
        "regions": [build_region_row(design, i) for i in range(len(design.regions))],
        "patches": [
            {
                "id": patch.id,
                "rows": patch.rows,
                "columns": patch.columns,
                "taxels": int(counts[number]),
                "taxels_close": int(close[number]),
                "distortion": round(design.layouts[number].distortion, 4),
                "wiring_mm": round(drawings[number].trace_length, 1),
            }
            for number, patch in enumerate(skin.patches)
        ],
        "warnings": list(design.warnings),
    }


def build_region_row(design: SkinDesign, number: int) -> dict[str, object]:
    """Build the figures of one region."""
    result = design.regions[number]
    skin = design.skin
    own = np.isin(skin.patch_index, result.patches)
    covered = PER_CM2 * float(skin.areas[own].sum())
    distortions = [design.layouts[i].distortion for i in result.patches]
    return {
        "link": result.region.zone.link,
        "asked_per_cm2": round(result.region.density / PER_CM2, 4),
        "density_per_cm2": round(int(own.sum()) / covered, 4) if covered else 0.0,
        "area_cm2": round(PER_CM2 * result.area, 2),
        "allowed_cm2": round(PER_CM2 * result.allowed_area, 2),
        "covered_cm2": round(covered, 2),
        "taxels": int(own.sum()),
        "taxels_close": int(design.close[own].sum()),
        "patches": len(result.patches),
        "distortion_max": round(max(distortions, default=0.0), 4),
    }


def count_scan_bits(taxels: int) -> int:
    """Return the bits that the device protocol sends for one scan of a patch."""
    overhead = HEADER.size + DATA_BODY.size + CRC.size
    return BITS_PER_BYTE * (
        BYTES_PER_COUNT * taxels + overhead * ceil(taxels / MAX_COUNTS)
    )
