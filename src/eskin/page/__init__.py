"""The page in the browser, in a process of its own: it needs no recogniser."""

from eskin.page.colours import ColourScale
from eskin.page.orders import Order, PageOrder, TouchOrder
from eskin.page.picture import (
    Answer,
    ArmLine,
    Board,
    ContactMark,
    Picture,
    Saying,
    TouchNow,
)
from eskin.page.setup import Setup, Solid

__all__ = [
    "Answer",
    "ArmLine",
    "Board",
    "ColourScale",
    "ContactMark",
    "Order",
    "PageOrder",
    "Picture",
    "Saying",
    "Setup",
    "Solid",
    "TouchNow",
    "TouchOrder",
]
