"""A recording as it would have come had something been otherwise."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

import numpy as np
from jaxtyping import Float

from eskin.recording import Recording
from eskin.skin import Skin
from eskin.touch import Scan

AT_REST = 50
"""Readings whose median is taken for the rest of a taxel."""


class Version(ABC):
    """What differs from the recording; its `repr` names it, in files too."""

    @abstractmethod
    def scans(self, recording: Recording) -> Iterator[Scan]:
        """The scans that would have come."""

    def skin(self, skin: Skin, start: int) -> Skin:
        """Where the taxels are believed to be; where they are, unless said otherwise.

        Args:
            skin: that is believed in.
            start: stamp of the recording's first scan [ns since the epoch].
        """
        return skin


def at_rest(recording: Recording) -> Float[np.ndarray, "taxel"]:
    """Counts of each taxel while nothing touches it."""
    return np.median([s.counts for s in islice(recording.scans(), AT_REST)], axis=0)


def recounted(scan: Scan, counts: Float[np.ndarray, "taxel"], full_scale: int) -> Scan:
    """The scan with other counts, as its converter gives them, where it received."""
    whole = np.clip(np.rint(counts), 0, full_scale)
    kept = np.where(scan.received, whole, scan.counts)
    return replace(scan, counts=kept.astype(scan.counts.dtype))
