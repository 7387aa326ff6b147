"""This package converts public sets of touches to recordings."""

from typing import Literal

from eskin.learn.sets.conversion import ConversionResult
from eskin.learn.sets.shearsense import convert_shearsense
from eskin.learn.sets.sleeve import convert_sleeve
from eskin.learn.sets.socialtouch import convert_socialtouch
from eskin.learn.sets.table import LAYOUTS, TableLayout, convert_table

SetName = Literal["sleeve", "shearsense", "socialtouch", "cost", "haart", "capfingerid"]
"""Names of the public sets."""

__all__ = [
    "LAYOUTS",
    "ConversionResult",
    "TableLayout",
    "convert_shearsense",
    "convert_sleeve",
    "convert_socialtouch",
    "convert_table",
]
