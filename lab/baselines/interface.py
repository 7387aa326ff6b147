"""This module defines baselines, which classify windows of the whole skin.

A baseline is built for one skin on one robot, is fitted to labelled windows of two
seconds and classifies others, all at once or one reading after the other.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import SkinMismatchError
from eskin.skin import MountedSkin
from lab.baselines.estimators import Estimator

READINGS = 100
"""Readings of a window: two seconds at 50 Hz, as in the paper (section IV-C)."""

STEP_NS = 20_000_000
"""Time from one reading of a window to the next [ns]."""

TOUCHED = 0.5
"""Pressure below which a taxel reads zero to methods that use geometry [kPa]."""

Probabilities = Float[np.ndarray, "clip class"]
Labels = Int[np.ndarray, "clip"]


@dataclass(frozen=True, eq=False)
class SkinWindows:
    """Skin windows hold pressures and joint positions, the oldest reading first."""

    pressure: Float[np.ndarray, "clip 100 taxel"]
    """Pressure of each taxel [kPa] (float32, or float16 where there are many)."""
    q: Float[np.ndarray, "clip 100 joint"]
    """Joint positions [rad] (float32)."""
    example: Int[np.ndarray, "clip"] | None = None
    """Example that each window is of, such as a labelled segment; None where each is of
    one of its own."""

    @property
    def count(self) -> int:
        """Return the number of windows."""
        return len(self.pressure)

    def select(self, chosen: Bool[np.ndarray, "clip"]) -> "SkinWindows":
        """Return the windows for which `chosen` is true."""
        example = None if self.example is None else self.example[chosen]
        return SkinWindows(self.pressure[chosen], self.q[chosen], example)


class BaselineStream(ABC):
    """A stream classifies with a fitted baseline, one reading at a time."""

    @abstractmethod
    def push(
        self, pressure: Float[np.ndarray, "taxel"], q: Float[np.ndarray, "joint"]
    ) -> Float[np.ndarray, "class"]:
        """Return the probabilities of the window that ends with this reading."""


class Baseline(ABC):
    """A baseline classifies windows of one skin."""

    def __init__(self, mounted: MountedSkin) -> None:
        """Create an untrained baseline for a skin on its robot."""
        self.mounted = mounted
        self.classes = 0

    @final
    def fit(self, clips: SkinWindows, labels: Labels, seed: int = 0) -> "Baseline":
        """Fit the baseline to labelled windows; results are reproducible by the seed.

        Args:
            clips: windows to train on.
            labels: class of each window, from 0; every class up to the last one occurs.
            seed: seed of all random draws.

        Raises:
            SkinMismatchError: if the windows are of another skin or robot.
            ValueError: if the labels do not fit the windows, or a class is missing.
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
        self.fit_windows(clips, labels, seed)
        return self

    @final
    def predict_probabilities(self, clips: SkinWindows) -> Probabilities:
        """Return the probabilities of the classes for each window.

        Raises:
            SkinMismatchError: if the windows are of another skin or robot.
            ValueError: if the baseline has not been fitted.
        """
        self.check(clips)
        if not self.classes:
            raise ValueError(
                f"{type(self).__name__} has learned nothing yet; allowed are fitted "
                "ones; call fit first"
            )
        return self.predict_windows(clips)

    def build_streams(self) -> dict[str, BaselineStream]:
        """Return streams that classify one reading after the other, by name.

        Results are those of `predict_probabilities`, except that a method may also use
        the reading before the window. Readings before the first one have no touch.
        """
        return {"": WindowStream(self)}

    @abstractmethod
    def fit_windows(self, clips: SkinWindows, labels: Labels, seed: int) -> None:
        """Fit windows that have been checked."""

    @abstractmethod
    def predict_windows(self, clips: SkinWindows) -> Probabilities:
        """Classify windows that have been checked."""

    def check(self, clips: SkinWindows) -> None:
        """Reject windows of another skin or robot."""
        skin = self.mounted.skin
        robot = self.mounted.robot
        wanted = (READINGS, skin.count), (READINGS, len(robot.joint_names))
        got = clips.pressure.shape[1:], clips.q.shape[1:]
        if got != wanted:
            raise SkinMismatchError(
                f"clips of {got[0]} pressures and {got[1]} joint positions; allowed on "
                f"skin '{skin.name}' of robot '{robot.name}' are {wanted[0]} and "
                f"{wanted[1]}; take the baseline that was made for their skin"
            )


class RowBaseline(Baseline):
    """A row baseline classifies each window by a row of features."""

    def __init__(
        self, mounted: MountedSkin, estimator: Callable[[int], Estimator]
    ) -> None:
        """Create an untrained baseline.

        Args:
            mounted: the skin on its robot.
            estimator: function that builds the classifier of rows from a seed.
        """
        super().__init__(mounted)
        self.estimator = estimator
        self.model: Estimator = None

    @abstractmethod
    def compute_rows(self, clips: SkinWindows) -> Float[np.ndarray, "clip feature"]:
        """Return the features of each window."""

    def fit_windows(self, clips: SkinWindows, labels: Labels, seed: int) -> None:
        """Fit windows that have been checked."""
        self.model = self.estimator(seed).fit(self.compute_rows(clips), labels)

    def predict_windows(self, clips: SkinWindows) -> Probabilities:
        """Classify windows that have been checked."""
        return np.asarray(self.model.predict_proba(self.compute_rows(clips)))


@final
class RollingWindow:
    """A rolling window holds the last rows of a series without moving any."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        """Start with rows of zeros of this shape."""
        self.buffer = np.zeros((2 * READINGS, *shape), np.float32)
        self.position = 0

    def push(self, row: np.ndarray) -> np.ndarray:
        """Add a row and return the last `READINGS`, oldest first."""
        self.buffer[self.position] = self.buffer[self.position + READINGS] = row
        self.position = (self.position + 1) % READINGS
        return self.buffer[self.position : self.position + READINGS]


@final
class WindowStream(BaselineStream):
    """A window stream classifies the whole window again at every reading."""

    def __init__(self, baseline: Baseline) -> None:
        """Start with a window without touch."""
        self.baseline = baseline
        mounted = baseline.mounted
        self.pressure = RollingWindow((mounted.skin.count,))
        self.q = RollingWindow((len(mounted.robot.joint_names),))

    def push(
        self, pressure: Float[np.ndarray, "taxel"], q: Float[np.ndarray, "joint"]
    ) -> Float[np.ndarray, "class"]:
        """Return the probabilities of the window that ends with this reading."""
        clip = SkinWindows(self.pressure.push(pressure)[None], self.q.push(q)[None])
        return self.baseline.predict_probabilities(clip)[0]
