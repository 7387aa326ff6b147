"""This package converts public sets of touches, and tables, to recordings."""

from eskin.sets.conversion import ConversionResult
from eskin.sets.shearsense import convert_shearsense
from eskin.sets.skin_table import ReadingLayout, convert_readings
from eskin.sets.sleeve import convert_sleeve
from eskin.sets.socialtouch import convert_socialtouch
from eskin.sets.table import LAYOUTS, TableLayout, convert_table
from eskin.sets.taxel_poses import PoseFit

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
