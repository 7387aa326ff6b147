"""Transforms change a recording into what another skin would have recorded."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.model import check_limits
from eskin.recording import Recording
from eskin.skin import Skin
from eskin.touch import Calibration, Scan

REST_READINGS = 50
"""Readings whose median is taken for the rest of a taxel."""


class RecordingTransform(ABC):
    """What differs from the recording; its `repr` names it, in files too."""

    @property
    def moves(self) -> bool:
        """Whether it is the places of taxels that are wrong, and no scan."""
        return False

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


def estimate_rest_counts(recording: Recording) -> Float[np.ndarray, "taxel"]:
    """Counts of each taxel while nothing touches it."""
    return np.median(
        [s.counts for s in islice(recording.scans(), REST_READINGS)], axis=0
    )


def replace_counts(
    scan: Scan, counts: Float[np.ndarray, "taxel"], full_scale: int
) -> Scan:
    """The scan with other counts, as its converter gives them, where it received."""
    whole = np.clip(np.rint(counts), 0, full_scale)
    kept = np.where(scan.received, whole, scan.counts)
    return replace(scan, counts=kept.astype(scan.counts.dtype))


LIMITS = {
    "patch_gain": (0.0, np.inf),
    "taxel_gain": (0.0, np.inf),
    "exponent": (0.0, np.inf),
    "unfelt": (0.0, np.inf),
    "noise": (0.0, 1.0),
}
"""Smallest and largest values of the settings."""

UNFELT_SCATTER = 0.2
"""Spread of the logarithm of what a taxel does not feel, within its patch."""

REFERENCE = 30.0
"""Pressure that a bent curve leaves as it is [kPa]."""


@dataclass(frozen=True)
class AgingConfig:
    """How far another skin may be from the one that recorded."""

    patch_gain: float = 0.4
    """Spread of the logarithm of the gain of a patch."""

    taxel_gain: float = 0.3
    """Spread of the logarithm of the gain of a taxel within its patch."""

    exponent: float = 0.15
    """Spread of the logarithm of the power of pressure that a patch follows."""

    unfelt: float = 5.0
    """Largest mean pressure of which a patch feels nothing [kPa]; taxels differ."""

    noise: float = 0.001
    """Largest deviation of white noise, as a share of full scale."""

    def __post_init__(self) -> None:
        """Refuse numbers that mean nothing."""
        check_limits(self, LIMITS)


@final
@dataclass(frozen=True)
class Aging(RecordingTransform):
    """One such skin: the same numbers give the same recording the same skin."""

    config: AgingConfig
    """How far it may be."""
    number: int
    """Which of those drawn."""

    def scans(self, recording: Recording) -> Iterator[Scan]:
        """The recording's scans with the other skin's counts; shear stays as it is."""
        rng = np.random.default_rng([recording.start, self.number])
        calibration = recording.calibration
        skin = draw_aged_skin(recording.skin, self.config, rng)
        noise = self.config.noise * calibration.full_scale * rng.random()
        rest = estimate_rest_counts(recording)
        for scan in recording.scans():
            above = skin.felt(scan.counts - rest, calibration)
            noisy = rest + above + noise * rng.standard_normal(len(rest))
            yield replace_counts(scan, noisy, calibration.full_scale)


@dataclass(frozen=True, eq=False)
class AgedSkin:
    """What sets each taxel of a skin apart from that of the skin that recorded."""

    gain: Float[np.ndarray, "taxel"]
    """What it multiplies pressure by."""
    exponent: Float[np.ndarray, "taxel"]
    """Power of pressure that it follows."""
    unfelt: Float[np.ndarray, "taxel"]
    """Pressure of which it feels nothing [kPa]."""

    def felt(
        self, above: Float[np.ndarray, "taxel"], calibration: Calibration
    ) -> Float[np.ndarray, "taxel"]:
        """Counts above rest that it gives where the skin that recorded gave `above`."""
        left = np.maximum(calibration.compute_pressure(above) - self.unfelt, 0.0)
        bent = self.gain * REFERENCE * (left / REFERENCE) ** self.exponent
        return calibration.compute_counts(bent)


def draw_aged_skin(
    skin: Skin, config: AgingConfig, rng: np.random.Generator
) -> AgedSkin:
    """Draw another skin of the same layout."""
    patch, patches, drawn = skin.patch_index, len(skin.patches), rng.standard_normal
    gain = (config.patch_gain * drawn(patches))[patch]
    gain += config.taxel_gain * drawn(skin.count)
    unfelt = (config.unfelt * rng.random(patches))[patch]
    unfelt *= np.exp(UNFELT_SCATTER * drawn(skin.count))
    exponent = np.exp(config.exponent * drawn(patches))[patch]
    return AgedSkin(np.exp(gain), exponent, unfelt)
