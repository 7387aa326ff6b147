"""Designs make the skin of any robot, from its meshes to patches and their drawings."""

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
