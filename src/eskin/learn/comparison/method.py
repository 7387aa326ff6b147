"""What is compared: something that learns from clips, and answers others."""

from abc import ABC, abstractmethod
from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from eskin.learn.comparison.examples import Examples

Answers = Callable[[Examples], Float[np.ndarray, "clip class"]]
"""Log-probabilities of the classes for each clip, in the order of the gestures that
were learned."""


class Method(ABC):
    """Learns from clips of a skin."""

    @abstractmethod
    def fit(self, examples: Examples, seed: int) -> Answers:
        """Learn from clips; the same seed gives the same result.

        Args:
            examples: to learn from.
            seed: decides everything that is drawn.
        """
