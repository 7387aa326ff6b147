"""What was really done to the robot."""

from dataclasses import dataclass

from eskin.sim.contact.press import Press


@dataclass(frozen=True, eq=False)
class TrueTouch:
    """One thing that somebody or something did to the skin."""

    gesture: str
    """Of the vocabulary: poke, double_pat, grab, stroke or none; an unknown gesture
    such as rub has its own name."""
    kind: str
    """Variant, such as `two_tips` or `bump`."""
    subject: str
    """Who did it; empty where it was nobody."""
    presses: tuple[Press, ...]
    """What presses where; more than one body, or one on two charts."""
    drawn: dict[str, float | str]
    """Every parameter that was drawn for it, by name."""
