"""Skins: patches, taxels, their files, their place on a robot and their distances."""

from eskin.skin.check import CheckConfig, Problem, check_skin
from eskin.skin.files import (
    Draft,
    load_skin,
    read_draft,
    save_skin,
    skin_from_bytes,
    skin_to_bytes,
)
from eskin.skin.layout import Grid, grid_skin, join_patches, without_corners
from eskin.skin.mounted_skin import MountedSkin
from eskin.skin.presets import PRESETS, Preset, robot_for
from eskin.skin.skin import Patch, Skin
from eskin.skin.surfaces import Dome, Plane, Surface, Tube, Wrapped, fit_surface

__all__ = [
    "PRESETS",
    "CheckConfig",
    "Dome",
    "Draft",
    "Grid",
    "MountedSkin",
    "Patch",
    "Plane",
    "Preset",
    "Problem",
    "Skin",
    "Surface",
    "Tube",
    "Wrapped",
    "check_skin",
    "fit_surface",
    "grid_skin",
    "join_patches",
    "load_skin",
    "read_draft",
    "robot_for",
    "save_skin",
    "skin_from_bytes",
    "skin_to_bytes",
    "without_corners",
]
