"""The page in the browser, in a process of its own: it needs no recogniser."""

from eskin.page.colours import ColourScale
from eskin.page.messages import (
    Answer,
    ArmLine,
    Board,
    ContactMark,
    Order,
    PageOrder,
    Picture,
    Saying,
    Setup,
    Solid,
    TouchNow,
    TouchOrder,
)

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
