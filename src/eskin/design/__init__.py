"""Designs make the skin of any robot, from its meshes to patches and their drawings.

The names below are imported when they are first used: a command tells its options
without the packages of the extra `design`.
"""

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from eskin.design.design import RegionResult, SkinDesign, design_skin
    from eskin.design.drawing import PatchDrawing, arrange_sheet, draw_patch
    from eskin.design.files import build_report, draw_design, save_design
    from eskin.design.maps import load_map, save_map
    from eskin.design.patches import PatchLayout
    from eskin.design.spec import DesignLimits, DesignSpec, RegionSpec, read_spec
    from eskin.design.surface import (
        LinkSurface,
        SurfaceDistance,
        build_link_surface,
        compute_kinematic_distances,
    )
    from eskin.design.unroll import FlatRegion, UnrolledMesh, unroll_region
    from eskin.design.zones import BallZone, BoxZone, LinkZone, Zone

EXPORTS = {
    "design": "RegionResult SkinDesign design_skin",
    "drawing": "PatchDrawing arrange_sheet draw_patch",
    "files": "build_report draw_design save_design",
    "maps": "load_map save_map",
    "patches": "PatchLayout",
    "spec": "DesignLimits DesignSpec RegionSpec read_spec",
    "surface": "LinkSurface SurfaceDistance build_link_surface "
    "compute_kinematic_distances",
    "unroll": "FlatRegion UnrolledMesh unroll_region",
    "zones": "BallZone BoxZone LinkZone Zone",
}
MODULES = {name: module for module, names in EXPORTS.items() for name in names.split()}

__all__ = [
    "BallZone",
    "BoxZone",
    "DesignLimits",
    "DesignSpec",
    "FlatRegion",
    "LinkSurface",
    "LinkZone",
    "PatchDrawing",
    "PatchLayout",
    "RegionResult",
    "RegionSpec",
    "SkinDesign",
    "SurfaceDistance",
    "UnrolledMesh",
    "Zone",
    "arrange_sheet",
    "build_link_surface",
    "build_report",
    "compute_kinematic_distances",
    "design_skin",
    "draw_design",
    "draw_patch",
    "load_map",
    "read_spec",
    "save_design",
    "save_map",
    "unroll_region",
]


def __getattr__(name: str) -> object:
    """Import a name from its module when it is first used."""
    if name not in MODULES:
        raise AttributeError(f"module 'eskin.design' has no attribute '{name}'")
    return getattr(importlib.import_module(f"eskin.design.{MODULES[name]}"), name)
