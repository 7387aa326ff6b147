"""Classifiers on hand-made features of the window's contact graphs."""

from collections import deque
from collections.abc import Callable
from copy import copy
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.graph import GraphBatch, GraphBuilder, GraphConfig, join
from eskin.learn.baselines.estimators import Estimator
from eskin.learn.baselines.interface import (
    READINGS,
    STEP_NS,
    TOUCHED,
    Baseline,
    Clips,
    Labels,
    Probabilities,
    Stream,
)
from eskin.learn.hand_features import graph_features
from eskin.skin import MountedSkin
from eskin.touch import Reading

STAMPS = STEP_NS * np.arange(READINGS)


@final
class HandBaseline(Baseline):
    """A classifier of rows on features of all that is touched within the window."""

    def __init__(
        self, mounted: MountedSkin, estimator: Callable[[int], Estimator]
    ) -> None:
        """Make one that knows nothing yet.

        Args:
            mounted: the skin on its robot.
            estimator: makes the classifier of rows from a seed.
        """
        super().__init__(mounted)
        self.make = estimator
        self.model: Estimator = None

    def learn(self, clips: Clips, labels: Labels, seed: int) -> None:
        """Learn from windows that have been checked."""
        self.model = self.make(seed).fit(self.rows(clips), labels)

    def answer(self, clips: Clips) -> Probabilities:
        """Answer windows that have been checked."""
        return np.asarray(self.model.predict_proba(self.rows(clips)))

    def on(self, mounted: MountedSkin) -> "HandBaseline":
        """The same for a skin that lies elsewhere."""
        other = copy(self)
        other.mounted = mounted
        return other

    def streams(self) -> dict[str, Stream]:
        """One that makes each reading's graph once."""
        return {"": HandStream(self)}

    def rows(self, clips: Clips) -> Float[np.ndarray, "clip feature"]:
        """Features of each window."""
        return np.stack(
            [
                self.features(GraphWindow(self.mounted).fill(pressure, q))
                for pressure, q in zip(clips.pressure, clips.q, strict=True)
            ]
        )

    def features(self, graphs: GraphBatch) -> Float[np.ndarray, "feature"]:
        """Features of one window's graphs."""
        return graph_features(graphs, STAMPS, shear=False).astype(np.float32)


@final
class GraphWindow:
    """The contact graphs of the last readings, one of the whole skin for each."""

    def __init__(self, mounted: MountedSkin) -> None:
        """Start without a reading."""
        self.builder = GraphBuilder(mounted, GraphConfig().without_shear())
        self.valid = np.ones(mounted.skin.count, dtype=bool)
        self.graphs: deque[GraphBatch] = deque(maxlen=READINGS)
        self.earlier = np.empty(0, dtype=np.int64)
        self.stamp = 0

    def fill(
        self,
        pressure: Float[np.ndarray, "reading taxel"],
        q: Float[np.ndarray, "reading joint"],
    ) -> GraphBatch:
        """The graphs of the last readings, after taking these."""
        for row, joints in zip(pressure.astype(np.float32), q, strict=True):
            self.push(row, joints)
        return join(list(self.graphs))

    def push(
        self, pressure: Float[np.ndarray, "taxel"], q: Float[np.ndarray, "joint"]
    ) -> None:
        """Take the next reading."""
        taxels = np.flatnonzero(pressure >= TOUCHED)
        reading = Reading(self.stamp, pressure, self.valid, q.astype(np.float64))
        self.builder.advance(reading, taxels)
        self.graphs.append(self.builder.graph(taxels, self.earlier))
        self.earlier, self.stamp = taxels, self.stamp + STEP_NS


@final
class HandStream(Stream):
    """Answers after each reading; only the newest graph is made."""

    def __init__(self, baseline: HandBaseline) -> None:
        """Start with a window without touch."""
        self.baseline = baseline
        mounted = baseline.mounted
        self.window = GraphWindow(mounted)
        joints = len(mounted.robot.joint_names)
        self.window.fill(
            np.zeros((READINGS, mounted.skin.count), np.float32),
            np.zeros((READINGS, joints)),
        )

    def push(
        self, pressure: Float[np.ndarray, "taxel"], q: Float[np.ndarray, "joint"]
    ) -> Float[np.ndarray, "class"]:
        """Probabilities of the window that ends with this reading."""
        graphs = self.window.fill(pressure[None], q[None])
        row = self.baseline.features(graphs)[None]
        return np.asarray(self.baseline.model.predict_proba(row))[0]
