"""This module transforms recordings into those that another skin would have made."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import final

import numpy as np
from jaxtyping import Float

from eskin.compiled import digest_code
from eskin.files import NotNegative, Share
from eskin.live import check_limits
from eskin.recording import Recording
from eskin.skin import Skin
from eskin.touch import Calibration, Scan

REST_READINGS = 50
"""Number of first readings whose median estimates the counts at rest."""


class RecordingTransform(ABC):
    """A recording transform changes the scans of a recording, or its skin.

    Its `repr` shows all of its settings.
    """

    @property
    def key(self) -> str:
        """Return its settings and a digest of its code, for the names of files."""
        return f"{self} {digest_code(type(self).__module__)}"

    @abstractmethod
    def transform_scans(self, recording: Recording) -> Iterator[Scan]:
        """Yield the transformed scans of a recording."""

    def transform_skin(self, skin: Skin, start: int) -> Skin:
        """Return the skin that recognition assumes; the true one unless overridden.

        Args:
            skin: the true skin.
            start: stamp of the recording's first scan [ns since the epoch].
        """
        return skin


def estimate_rest_counts(recording: Recording) -> Float[np.ndarray, "taxel"]:
    """Return the counts of each taxel while nothing touches it."""
    first = islice(recording.scans(), REST_READINGS)
    return np.median([scan.counts for scan in first], axis=0)


def replace_counts(
    scan: Scan, counts: Float[np.ndarray, "taxel"], full_scale: int
) -> Scan:
    """Return a scan with other counts, rounded and clipped, where it was received."""
    rounded = np.clip(np.rint(counts), 0, full_scale)
    merged = np.where(scan.received, rounded, scan.counts)
    return replace(scan, counts=merged.astype(scan.counts.dtype))


UNFELT_SCATTER = 0.2
"""Standard deviation of the logarithm of `unfelt` within a patch."""

REFERENCE = 30.0
"""Pressure that does not depend on the exponent [kPa]."""


@dataclass(frozen=True)
class AgingConfig:
    """These settings limit how far an aged skin differs from the one that recorded."""

    patch_gain: NotNegative = 0.4
    """Standard deviation of the logarithm of a patch's gain."""
    taxel_gain: NotNegative = 0.3
    """Standard deviation of the logarithm of a taxel's gain within its patch."""
    exponent: NotNegative = 0.15
    """Standard deviation of the logarithm of a patch's exponent of pressure."""
    unfelt: NotNegative = 5.0
    """Largest pressure that a patch loses on average [kPa]; its taxels differ."""
    noise: Share = 0.001
    """Largest standard deviation of white noise, as a share of full scale."""

    def __post_init__(self) -> None:
        """Reject settings outside their limits."""
        check_limits(self)


@final
@dataclass(frozen=True)
class Aging(RecordingTransform):
    """This transform simulates an aged skin: weaker, less even, with more noise.

    The same configuration and number give a recording the same aged skin.
    """

    config: AgingConfig
    """Limits of the draw."""
    number: int
    """Number of the skin among those drawn."""

    def transform_scans(self, recording: Recording) -> Iterator[Scan]:
        """Yield the scans with the counts of the aged skin; shear is unchanged."""
        rng = np.random.default_rng([recording.start, self.number])
        calibration = recording.calibration
        skin = draw_aged_skin(recording.skin, self.config, rng)
        noise = self.config.noise * calibration.full_scale * rng.random()
        rest = estimate_rest_counts(recording)
        way = -1.0 if calibration.falling else 1.0
        for scan in recording.scans():
            above = way * skin.convert_counts(way * (scan.counts - rest), calibration)
            noisy = rest + above + noise * rng.standard_normal(len(rest))
            yield replace_counts(scan, noisy, calibration.full_scale)


@dataclass(frozen=True, eq=False)
class AgedSkin:
    """An aged skin gives each taxel its own curve of counts."""

    gain: Float[np.ndarray, "taxel"]
    """Factor on the pressure of each taxel."""
    exponent: Float[np.ndarray, "taxel"]
    """Exponent of the pressure of each taxel."""
    unfelt: Float[np.ndarray, "taxel"]
    """Pressure that each taxel loses [kPa]."""

    def convert_counts(
        self, above: Float[np.ndarray, "taxel"], calibration: Calibration
    ) -> Float[np.ndarray, "taxel"]:
        """Return the counts above rest where the original skin gave `above`."""
        felt = np.maximum(calibration.compute_pressure(above) - self.unfelt, 0.0)
        pressure = self.gain * REFERENCE * (felt / REFERENCE) ** self.exponent
        return calibration.compute_counts(pressure)


def draw_aged_skin(
    skin: Skin, config: AgingConfig, rng: np.random.Generator
) -> AgedSkin:
    """Draw an aged skin of the same layout."""
    patch = skin.patch_index
    patches = len(skin.patches)
    draw = rng.standard_normal
    log_gain = (config.patch_gain * draw(patches))[patch]
    log_gain += config.taxel_gain * draw(skin.count)
    unfelt = (config.unfelt * rng.random(patches))[patch]
    unfelt *= np.exp(UNFELT_SCATTER * draw(skin.count))
    exponent = np.exp(config.exponent * draw(patches))[patch]
    return AgedSkin(np.exp(log_gain), exponent, unfelt)
