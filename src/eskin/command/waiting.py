"""Touches that are not sure enough yet, or have not ended, and are waited for."""

from dataclasses import dataclass

from eskin.command.command_map import Rule
from eskin.live import Detection
from eskin.stream import Moment


@dataclass
class Waiting:
    """What a touch asks for, and how sure that is by now."""

    detection: Detection
    """What was said of it."""

    rule: Rule
    """That it asks by."""

    action: str
    """The plain action that it asks for."""

    needed: float
    """Confidence that the action needs."""

    confidence: float
    """The probability of its gesture at the latest moment of the touch."""

    touch: int
    """Id of the touch, or of what has taken it over."""

    closed: bool = False
    """Whether no more will be known of it."""

    @property
    def sure(self) -> bool:
        """Whether it is sure enough."""
        return self.confidence >= self.needed

    @property
    def doubt(self) -> str:
        """Why it is refused where it is not."""
        return f"confidence {self.confidence:.2f} is below {self.needed:.2f}"

    def follow(self, moment: Moment, vocabulary: tuple[str, ...]) -> None:
        """Take in the next moment.

        Args:
            moment: not earlier than what was said.
            vocabulary: in the order of its probabilities.
        """
        for touch in moment.state.over:
            if touch.id == self.touch:
                self.closed = not touch.merged_into
                self.touch = touch.merged_into or self.touch
        chances = moment.probabilities.get(self.touch)
        if chances is not None:
            self.confidence = float(chances[vocabulary.index(self.detection.gesture)])
