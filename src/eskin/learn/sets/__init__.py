"""This package converts public sets of touches to recordings."""

from eskin.learn.sets.conversion import ConversionResult
from eskin.learn.sets.shearsense import convert_shearsense
from eskin.learn.sets.sleeve import convert_sleeve
from eskin.learn.sets.socialtouch import convert_socialtouch

__all__ = [
    "ConversionResult",
    "convert_shearsense",
    "convert_sleeve",
    "convert_socialtouch",
]
