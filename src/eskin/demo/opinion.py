"""What a recogniser says of one touch, and what one says that never sees the pose."""

from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.command.command_map import WORDLESS
from eskin.demo.headless import DemoConfig
from eskin.demo.same_touch import SameTouch, draw_touches
from eskin.live import Detection, Recognizer
from eskin.model import Model, load_model
from eskin.touch import Scan

BLIND = "ur5-blind"


@dataclass(frozen=True, eq=False)
class Answer:
    """What is said of one playing."""

    said: tuple[tuple[str, float], ...]
    """Gesture and confidence of each touch, in the order in which they were said."""

    probabilities: Float[np.ndarray, "class"]
    """Of the strongest touch, as it was spoken of: at once, or after it closed by what
    its latest contact told; zeros before there is one."""

    @property
    def words(self) -> tuple[str, ...]:
        """What is said, in words."""
        return tuple(
            f"{gesture.replace('_', ' ')} {sure:.0%}" for gesture, sure in self.said
        )

    @property
    def gestures(self) -> list[str]:
        """What was recognised, less what is no gesture."""
        return [gesture for gesture, _ in self.said if gesture not in WORDLESS]

    def is_right(self, label: str) -> bool:
        """Whether it says what is truly done, once, and nothing else."""
        return self.gestures == ([] if label in WORDLESS else [label])


@final
class Opinion:
    """A recogniser that has heard nothing before, listening to one playing."""

    def __init__(self, model: Model, touch: SameTouch) -> None:
        """Listen with a model."""
        self.recognizer = Recognizer(model, touch.mounted, touch.calibration)
        self.classes = len(model.card.vocabulary)
        self.chances: dict[int, np.ndarray] = {}
        self.spoken: set[int] = set()
        self.detections: list[Detection] = []

    def hear(self, scan: Scan) -> None:
        """Take in the next scan."""
        said = self.recognizer.push(scan)
        self.detections += said
        state = self.recognizer.state
        assert state is not None
        heard = {touch.id for touch in state.going}
        heard |= {detection.touch for detection in said}
        self.chances |= {
            touch: chances
            for touch, chances in self.recognizer.probabilities.items()
            if touch in heard - self.spoken
        }
        self.spoken |= {detection.touch for detection in said}

    def finish(self) -> None:
        """Take in the end."""
        self.detections += self.recognizer.finish()

    @property
    def answer(self) -> Answer:
        """What it says so far."""
        touch = max(self.chances, default=None)
        if self.detections:
            touch = max(self.detections, key=lambda each: each.peak_force).touch
        chances = np.zeros(self.classes) if touch is None else self.chances[touch]
        said = tuple((each.gesture, each.confidence) for each in self.detections)
        return Answer(said, chances)


def answer_to(touch: SameTouch, side: int, model: Model) -> Answer:
    """What is said of the playing in one of its poses."""
    opinion = Opinion(model, touch)
    for scan in touch.scans(side, touch.period, None):
        opinion.hear(scan)
    opinion.finish()
    return opinion.answer


@dataclass(frozen=True, eq=False)
class Compared:
    """What two recognisers say of one touch in both of its poses."""

    labels: tuple[str, str]
    """What is truly done in either."""

    posed: tuple[Answer, Answer]
    """Of the one that sees the pose."""

    blind: tuple[Answer, Answer]
    """Of the one that does not."""

    def right(self, answers: tuple[Answer, Answer]) -> int:
        """In how many of the poses that is what is truly done."""
        return sum(map(Answer.is_right, answers, self.labels))

    @property
    def is_blind(self) -> bool:
        """Whether the one that sees no pose says the same twice, to the last digit."""
        one, other = self.blind
        alike = np.array_equal(one.probabilities, other.probabilities)
        return one.said == other.said and alike


def compare(number: int, config: DemoConfig) -> list[Compared]:
    """What both say of some touches, as fast as the computer can.

    Args:
        number: of touches.
        config: what is demonstrated.
    """
    models = both_models(config.model)
    touches = draw_touches(number, config.skin, config.build_kind, config.seed)
    found = []
    for touch in touches:
        posed, blind = (
            (answer_to(touch, 0, model), answer_to(touch, 1, model)) for model in models
        )
        found.append(Compared(touch.labels, posed, blind))
    return found


def both_models(name: str) -> tuple[Model, Model]:
    """A model, and one that was trained without ever seeing the pose."""
    return load_model(name), load_model(BLIND)
