"""Skins: patches, taxels, their files, their place on a robot and their distances."""

from eskin.skin.check import CheckConfig, check_skin
from eskin.skin.distance import GeometricDistance, kinematic_distance
from eskin.skin.draft import Draft, read_draft
from eskin.skin.files import load_skin, save_skin, skin_from_bytes, skin_to_bytes
from eskin.skin.fit import fit_surface
from eskin.skin.grids import grid_skin
from eskin.skin.layout import Grid, join_patches, without_corners
from eskin.skin.mount import MountedSkin
from eskin.skin.presets import PRESETS, Preset, robot_for
from eskin.skin.problem import Problem
from eskin.skin.round import Dome, Tube
from eskin.skin.skin import Patch, Skin
from eskin.skin.surface import Plane, Surface, Wrapped

__all__ = [
    "PRESETS",
    "CheckConfig",
    "Dome",
    "Draft",
    "GeometricDistance",
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
    "kinematic_distance",
    "load_skin",
    "read_draft",
    "robot_for",
    "save_skin",
    "skin_from_bytes",
    "skin_to_bytes",
    "without_corners",
]
