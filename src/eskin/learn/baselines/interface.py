"""What every baseline has in common: windows of the whole skin in, probabilities out.

A baseline is made for one skin on one robot, learns from labelled windows of two
seconds and answers others, all at once or one reading after the other.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Float, Int

from eskin.errors import SkinMismatchError
from eskin.skin import MountedSkin

READINGS = 100
"""Of a window: two seconds at 50 Hz, as in the paper (section IV-C)."""

STEP_NS = 20_000_000
"""From one reading of a window to the next [ns]."""

TOUCHED = 0.5
"""Pressure below which a taxel reads zero to the methods that see geometry [kPa]."""

Probabilities = Float[np.ndarray, "clip class"]
Labels = Int[np.ndarray, "clip"]


@dataclass(frozen=True, eq=False)
class SkinWindows:
    """Windows of the whole skin, oldest reading first."""

    pressure: Float[np.ndarray, "clip 100 taxel"]
    """[kPa] (float32, or float16 where there are many)"""

    q: Float[np.ndarray, "clip 100 joint"]
    """Joint positions [rad] (float32)."""

    @property
    def count(self) -> int:
        """How many there are."""
        return len(self.pressure)


class BaselineStream(ABC):
    """A fitted baseline that takes one reading at a time."""

    @abstractmethod
    def push(
        self, pressure: Float[np.ndarray, "taxel"], q: Float[np.ndarray, "joint"]
    ) -> Float[np.ndarray, "class"]:
        """Probabilities of the window that ends with this reading."""


class Baseline(ABC):
    """A classifier of windows of one skin."""

    def __init__(self, mounted: MountedSkin) -> None:
        """Make one that knows nothing yet of a skin on its robot."""
        self.mounted = mounted
        self.classes = 0

    @final
    def fit(self, clips: SkinWindows, labels: Labels, seed: int = 0) -> "Baseline":
        """Learn from labelled windows; the same seed gives the same result.

        Args:
            clips: to learn from.
            labels: of the clips, from 0; every class up to the last one occurs.
            seed: decides everything that is drawn.

        Raises:
            SkinMismatchError: the clips are of another skin or robot.
            ValueError: the labels do not belong to the clips, or a class is missing.
        """
        self.check(clips)
        classes = len(np.unique(labels))
        if len(labels) != clips.count or classes < 2 or labels.max() + 1 != classes:
            raise ValueError(
                f"{len(labels)} labels of {classes} classes up to {labels.max()} for "
                f"{clips.count} clips; allowed is one a clip, of at least two classes "
                "counted from 0 that all occur; leave out the classes that do not"
            )
        self.classes = classes
        self.learn(clips, labels, seed)
        return self

    @final
    def predict_probabilities(self, clips: SkinWindows) -> Probabilities:
        """Probabilities of the classes for each window.

        Raises:
            SkinMismatchError: the clips are of another skin or robot.
            ValueError: nothing has been learned yet.
        """
        self.check(clips)
        if not self.classes:
            raise ValueError(
                f"{type(self).__name__} has learned nothing yet; allowed are fitted "
                "ones; call fit first"
            )
        return self.answer(clips)

    def on(self, mounted: MountedSkin) -> "Baseline":
        """The same for a skin that lies elsewhere; itself if it looks at no places."""
        return self

    def streams(self) -> dict[str, BaselineStream]:
        """Ways to answer one reading after the other, by what sets them apart.

        All give what `predict_probabilities` gives, but for what a method knows of the
        reading before the window; readings before the first one are without touch.
        """
        return {"": WindowStream(self)}

    @abstractmethod
    def learn(self, clips: SkinWindows, labels: Labels, seed: int) -> None:
        """Learn from windows that have been checked."""

    @abstractmethod
    def answer(self, clips: SkinWindows) -> Probabilities:
        """Answer windows that have been checked."""

    def check(self, clips: SkinWindows) -> None:
        """Refuse windows of another skin or robot."""
        skin, robot = self.mounted.skin, self.mounted.robot
        wanted = (READINGS, skin.count), (READINGS, len(robot.joint_names))
        got = clips.pressure.shape[1:], clips.q.shape[1:]
        if got != wanted:
            raise SkinMismatchError(
                f"clips of {got[0]} pressures and {got[1]} joint positions; allowed on "
                f"skin '{skin.name}' of robot '{robot.name}' are {wanted[0]} and "
                f"{wanted[1]}; take the baseline that was made for their skin"
            )


@final
class RollingWindow:
    """The last rows of a series, oldest first, without moving any."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        """Start with rows of zeros of this shape."""
        self.twice = np.zeros((2 * READINGS, *shape), np.float32)
        self.at = 0

    def push(self, row: np.ndarray) -> np.ndarray:
        """Take the next row and return the last `READINGS`."""
        self.twice[self.at] = self.twice[self.at + READINGS] = row
        self.at = (self.at + 1) % READINGS
        return self.twice[self.at : self.at + READINGS]


@final
class WindowStream(BaselineStream):
    """Answers the whole window anew at every reading."""

    def __init__(self, baseline: Baseline) -> None:
        """Start with a window without touch."""
        self.baseline = baseline
        mounted = baseline.mounted
        self.pressure = RollingWindow((mounted.skin.count,))
        self.q = RollingWindow((len(mounted.robot.joint_names),))

    def push(
        self, pressure: Float[np.ndarray, "taxel"], q: Float[np.ndarray, "joint"]
    ) -> Float[np.ndarray, "class"]:
        """Probabilities of the window that ends with this reading."""
        clip = SkinWindows(self.pressure.push(pressure)[None], self.q.push(q)[None])
        return self.baseline.predict_probabilities(clip)[0]
