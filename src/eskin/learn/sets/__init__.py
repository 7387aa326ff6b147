"""This package converts public sets of touches, and tables, to recordings."""

from typing import Literal

from eskin.learn.sets.conversion import ConversionResult
from eskin.learn.sets.shearsense import convert_shearsense
from eskin.learn.sets.skin_table import ReadingLayout, convert_readings
from eskin.learn.sets.sleeve import convert_sleeve
from eskin.learn.sets.socialtouch import convert_socialtouch
from eskin.learn.sets.table import LAYOUTS, TableLayout, convert_table
from eskin.learn.sets.taxel_poses import PoseFit

SetName = Literal["sleeve", "shearsense", "socialtouch", "cost", "haart", "capfingerid"]
"""Names of the public sets."""

__all__ = [
    "LAYOUTS",
    "ConversionResult",
    "PoseFit",
    "ReadingLayout",
    "TableLayout",
    "convert_readings",
    "convert_shearsense",
    "convert_sleeve",
    "convert_socialtouch",
    "convert_table",
]
