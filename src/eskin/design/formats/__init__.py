"""Formats in which other projects describe where taxels are."""

from typing import Literal

from eskin.robot.urdf import URDF_SUFFIX

SkinFormat = Literal["skin", "urdf", "icub", "gentact"]
"""Formats of skins: a folder of eskin's own, and files of other projects."""
ICUB_SUFFIX = ".txt"
"""End of the name of a file of positions of the iCub."""
GENTACT_SUFFIX = ".csv"
"""End of the name of a file of GenTact."""
FORMATS: dict[str, SkinFormat] = {
    URDF_SUFFIX: "urdf",
    ICUB_SUFFIX: "icub",
    GENTACT_SUFFIX: "gentact",
}
"""Formats of other projects, by the ends of the names of their files."""
