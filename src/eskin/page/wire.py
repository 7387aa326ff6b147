"""What page and viewer tell each other, as pairs of a word and a value."""

from typing import Literal

Word = Literal["ready", "refused", "shown", "order"]
READY: Word = "ready"
"""The page is served; the value is its port."""
REFUSED: Word = "refused"
"""It cannot be served; the value says why."""
SHOWN: Word = "shown"
"""A picture has been shown: another may come."""
ORDER: Word = "order"
"""A person ordered something."""
