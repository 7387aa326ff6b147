"""Skins hold patches of taxels, and lie on robots; they come from presets or files."""

from eskin.skin.check import CheckConfig, SkinProblem, check_skin, describe_problems
from eskin.skin.files import (
    ParsedSkin,
    load_skin,
    parse_skin_folder,
    save_skin,
    skin_from_bytes,
    skin_to_bytes,
)
from eskin.skin.layout import TaxelGrid, build_grid_skin, build_skin, cut_corners
from eskin.skin.mounting import (
    KeptRobot,
    describe_robot,
    load_robot_for_skin,
    mount_skin,
    require_robot,
)
from eskin.skin.presets import SKIN_PRESETS, SkinPreset
from eskin.skin.skin import MountedSkin, Patch, Skin
from eskin.skin.surfaces import Dome, Plane, Surface, SurfacePoints, Tube, fit_surface

__all__ = [
    "SKIN_PRESETS",
    "CheckConfig",
    "Dome",
    "KeptRobot",
    "MountedSkin",
    "ParsedSkin",
    "Patch",
    "Plane",
    "Skin",
    "SkinPreset",
    "SkinProblem",
    "Surface",
    "SurfacePoints",
    "TaxelGrid",
    "Tube",
    "build_grid_skin",
    "build_skin",
    "check_skin",
    "describe_problems",
    "describe_robot",
    "cut_corners",
    "fit_surface",
    "load_robot_for_skin",
    "load_skin",
    "mount_skin",
    "parse_skin_folder",
    "require_robot",
    "save_skin",
    "skin_from_bytes",
    "skin_to_bytes",
]
