"""This module computes readings from scans: baselines, pressure, crosstalk."""

from dataclasses import dataclass, replace
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import build_parameters
from eskin.errors import SkinError
from eskin.skin import Skin
from eskin.touch.adjacency import Adjacency
from eskin.touch.calibration import Calibration
from eskin.touch.calibration_kernels import (
    GHOST,
    LEAK,
    BaselineParameters,
    BaselineState,
    CrosstalkEstimate,
    MatrixPatch,
    calibrate,
    compensate_patch,
)
from eskin.touch.fault_kernels import CLEAR_FACTOR
from eskin.touch.known_rest import KnownRest
from eskin.touch.reading import Reading, Scan, check_count, check_order
from eskin.units import NS_PER_S

MIN_CROSSTALK_PRESSURE = 1.5
"""Greatest pressure of a patch up to which crosstalk is ignored [kPa]."""
NO_TAXELS = np.empty(0, np.int64)
MAX_OBSERVATIONS = 200
"""Number of latest observations whose median is the estimate."""
MAX_CELLS_PER_TAXEL, FREE_CELLS = 20, 1000
"""Largest number of crossings of the rows and columns of a patch for each of its
taxels, beyond some that are free."""


@dataclass(frozen=True)
class CalibrationConfig:
    """Settings describe how baselines are tared and tracked. All times are in [s]."""

    tare_seconds: float = 2.0
    """Duration of the tare, which begins when a taxel is first received."""
    tare_samples: int = 16
    """Number of samples of the tare."""
    tare_rank: float = 0.25
    """Quantile of the samples that is the baseline: low, to exclude touches."""
    margin: float = 1.5
    """Pressure above the baseline from which a taxel may be touched [kPa]; where it is
    as far below, the baseline is too high."""
    drift_seconds: float = 10.0
    """Time constant of tracking the drift of an untouched taxel."""
    low_seconds: float = 0.3
    """Time constant of lowering a baseline that is too high."""
    freeze_seconds: float = 3.0
    """How long after a touch the baselines of a taxel and its neighbours stay fixed."""
    longest_seconds: float = 120.0
    """Duration from which an uninterrupted touch counts as a change of the baseline."""
    stale_seconds: float = 5.0
    """Time constant of tracking such a change."""
    after_fraction: float = 0.1
    """Residual of a released taxel that is no touch, over its recent peak above the
    baseline in counts."""
    fade_seconds: float = 20.0
    """Time constant of the decay of the recent peak."""
    steady_seconds: float = 1.0
    """Time without change above the baseline from which a taxel counts as at rest. No
    finger keeps so still, while the residual after a touch, or the response to a bend
    of the skin, remains."""
    residual: float = 0.25
    """Largest residual of a touch, in units of its peak."""
    alone_seconds: float = 1.0
    """Time without change from which a single taxel above the baseline, beside which
    none is touched, has a new offset [s]."""
    dip_seconds: float = 20.0
    """Time after a touch in which counts may be below the baseline, to which they
    recover [s]."""
    dip_share: float = 0.15
    """Largest such dip, in units of the peak of the touch."""
    still: float = 0.25
    """Largest difference that counts as no change, in units of `margin`."""
    kept: float = 5.0
    """Largest residual that is expected of a sensor, in units of `margin`."""
    settle_seconds: float = 0.3
    """Time constant of tracking counts that do not change."""
    relearn_seconds: float = 2.0
    """Time constant of tracking the residual of a released taxel."""
    silence_seconds: float = 10.0
    """Time without data after which a taxel is tared again: its patch may be new."""


@final
class Calibrator:
    """A calibrator converts the counts of one skin to kPa, scan by scan; stateful.

    The result depends only on the scans and their stamps, so a recording that is
    replayed at any rate gives the same readings as the live device.
    """

    def __init__(
        self,
        skin: Skin,
        calibration: Calibration,
        config: CalibrationConfig | None = None,
    ) -> None:
        """Start without a baseline."""
        calibration.check_skin(skin)
        self.skin = skin
        self.calibration = calibration
        self.config = config or CalibrationConfig()
        self.adjacency = Adjacency.build(skin)
        self.gain = np.asarray(calibration.gain, np.float64)
        self.curve = calibration.pressure_curve
        self.least_margin = calibration.compute_counts(self.config.margin)
        self.margin = self.least_margin
        self.noise: np.ndarray | None = None
        self.known_rest = (
            None if calibration.rest is None else KnownRest(skin, calibration)
        )
        self.parameters = build_parameters(BaselineParameters, self.config)
        self.state = build_baseline_state(skin.count, self.config.tare_samples)
        self.shear_rest = np.full((skin.count, 2), float(calibration.shear_rest))
        self.first: int | None = None
        self.last: int | None = None

    def set_noise(self, counts: Float[np.ndarray, "taxel"]) -> None:
        """Set the counts above rest of each taxel up to which they are noise.

        A taxel may be touched from twice of it on.
        """
        if counts is not self.noise:
            self.noise = counts
            self.margin = np.maximum(self.least_margin, CLEAR_FACTOR * counts)

    def push(
        self,
        scan: Scan,
        faulty: Bool[np.ndarray, "taxel"] | None = None,
        held: Int[np.ndarray, "held"] | None = None,
    ) -> Reading:
        """Calibrate the next scan.

        Args:
            scan: the scan.
            faulty: faulty taxels, which are not valid and not tracked.
            held: indices of the taxels that were in contact at the last reading: their
                baselines stay.
        """
        check_count(scan, self.skin)
        check_order(self.last, scan.stamp)
        if self.first is None:
            self.first = scan.stamp
        seconds = (scan.stamp - self.first) / NS_PER_S
        elapsed = 0.0 if self.last is None else (scan.stamp - self.last) / NS_PER_S
        self.last = scan.stamp
        use = scan.received if faulty is None else scan.received & ~faulty
        if self.known_rest is not None:
            self.start_from_rest(self.known_rest, scan.counts, use, seconds)
        pressure = np.empty(self.skin.count, np.float32)
        calibrate(
            scan.counts,
            use,
            seconds,
            self.gain,
            self.curve,
            self.margin,
            self.adjacency.starts,
            self.adjacency.neighbours,
            NO_TAXELS if held is None else held,
            self.state,
            self.parameters,
            pressure,
        )
        shear = None
        if scan.shear is not None:
            shear = self.calibrate_shear(scan.shear, use, seconds, elapsed)
        return Reading(scan.stamp, pressure, use.copy(), scan.q, shear)

    def start_from_rest(
        self,
        known: KnownRest,
        counts: Int[np.ndarray, "taxel"],
        use: Bool[np.ndarray, "taxel"],
        seconds: float,
    ) -> None:
        """Start baselines from the calibrated rest where a taxel has its first data.

        The same holds after a long silence. Where that rest is not plausible, the taxel
        is tared.
        """
        state = self.state
        starts = use & (seconds - state.last_received > self.config.silence_seconds)
        if not starts.any():
            return
        rest, plausible = known.compare(counts, use, self.margin, self.adjacency)
        found = starts & plausible
        state.baseline[found] = rest[found]
        state.sample_count[found] = self.config.tare_samples
        state.peak[found] = 0.0
        state.touched_since[found] = np.inf
        state.low[found] = state.low_since[found] = np.inf
        # They have been received, so the kernel does not tare them for their silence.
        state.last_received[found] = seconds

    def calibrate_shear(
        self,
        counts: Int[np.ndarray, "taxel 2"],
        use: Bool[np.ndarray, "taxel"],
        seconds: float,
        elapsed: float,
    ) -> Float[np.ndarray, "taxel 2"]:
        """Calibrate shear, and track its baseline while the taxel is untouched."""
        above = counts - self.shear_rest
        idle = use & (seconds - self.state.last_touched > self.config.freeze_seconds)
        step = elapsed / (self.config.drift_seconds + elapsed)
        self.shear_rest[idle] += step * above[idle]
        shear = (above * self.calibration.shear_gain).astype(np.float32)
        shear[~use] = 0.0
        return shear


def build_baseline_state(count: int, samples: int) -> BaselineState:
    """Build the state of a skin before its first scan."""
    return BaselineState(
        baseline=np.zeros(count),
        above=np.zeros(count),
        peak=np.zeros(count),
        low=np.full(count, np.inf),
        low_since=np.full(count, np.inf),
        last_received=np.full(count, -np.inf),
        touched_since=np.full(count, np.inf),
        last_touched=np.full(count, -np.inf),
        steady_level=np.full(count, np.inf),
        steady_since=np.full(count, -np.inf),
        next_sample=np.full(count, -np.inf),
        sample_count=np.zeros(count, np.int64),
        samples=np.zeros((count, samples)),
    )


@final
class CrosstalkCompensator:
    """A compensator estimates and subtracts the crosstalk of a row-column array.

    The current of a pressed taxel leaks into the others of its row and column. It also
    takes detours over three taxels, so that a fourth, where touched rows and columns
    cross, seems touched (a ghost). Both are proportional to the conductance of the
    others, with coefficients that are the same all over a device. They are observed
    whenever it is touched, as most of the taxels concerned are not touched themselves.
    """

    def __init__(self, skin: Skin, calibration: Calibration) -> None:
        """Start without an estimate; without effect where the device is no matrix."""
        patches = range(len(skin.patches) if calibration.matrix else 0)
        self.patches = [build_matrix_patch(skin, p, calibration) for p in patches]
        self.curve = calibration.pressure_curve
        self.estimate = CrosstalkEstimate(
            np.zeros(2), np.zeros(2, np.int64), np.zeros((2, MAX_OBSERVATIONS))
        )

    @property
    def leak(self) -> float:
        """Apparent conductance of a taxel over that of the others of its lines."""
        return float(self.estimate.value[LEAK])

    @property
    def ghost(self) -> float:
        """Apparent conductance of a taxel over that of detours over three others."""
        return float(self.estimate.value[GHOST])

    def compensate(self, reading: Reading) -> Reading:
        """Update the estimate, and return the reading without crosstalk."""
        if not self.patches or reading.pressure.max() <= MIN_CROSSTALK_PRESSURE:
            return reading
        pressure = np.where(reading.valid, reading.pressure, np.float32(0.0))
        for patch in self.patches:
            if pressure[patch.taxels].max() > MIN_CROSSTALK_PRESSURE:
                compensate_patch(
                    pressure, reading.valid, self.curve, patch, self.estimate
                )
        return replace(reading, pressure=pressure)


def build_matrix_patch(skin: Skin, patch: int, calibration: Calibration) -> MatrixPatch:
    """Build the rows and columns of one patch, and buffers for its conductances."""
    gain = np.asarray(calibration.gain, np.float64)
    taxels = np.flatnonzero(skin.patch_index == patch)
    _, rows = np.unique(skin.rows[taxels], return_inverse=True)
    _, columns = np.unique(skin.columns[taxels], return_inverse=True)
    shape, count = (rows.max() + 1, columns.max() + 1), len(taxels)
    if shape[0] * shape[1] > MAX_CELLS_PER_TAXEL * count + FREE_CELLS:
        raise SkinError(
            f"patch '{skin.patches[patch].id}' has {count} taxels in {shape[0]} rows "
            f"and {shape[1]} columns; allowed is a taxel at one crossing in "
            f"{MAX_CELLS_PER_TAXEL} or more; correct the rows and columns"
        )
    return MatrixPatch(
        taxels,
        rows,
        columns,
        half_scale=gain[taxels] * calibration.full_scale,
        shown=np.zeros(shape),
        own=np.zeros(shape),
        row_sums=np.zeros(shape[0]),
        column_sums=np.zeros(shape[1]),
        lines=np.zeros(count),
        detours=np.zeros(count),
        shares=np.zeros(count),
    )
