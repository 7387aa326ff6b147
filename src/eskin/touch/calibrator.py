"""This module computes readings from scans: baselines, pressure, crosstalk."""

from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.errors import SkinError
from eskin.skin import Skin
from eskin.touch.adjacency import Adjacency, TaxelGroups
from eskin.touch.belief_kernels import CLEAR_FACTOR
from eskin.touch.calibration import Calibration
from eskin.touch.calibration_kernels import (
    BASELINE,
    GHOST,
    LEAK,
    MATRIX_LINE_SHARE,
    SILENCE_SECONDS,
    BaselineContext,
    BaselineParameters,
    CalibrationConfig,
    CrosstalkEstimate,
    MatrixPatch,
    calibrate,
    compensate_patch,
)
from eskin.touch.reading import Reading, Scan, check_count, check_order
from eskin.units import NS_PER_S

Flags = Bool[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]
Counts = Int[np.ndarray, "taxel"]
MIN_CROSSTALK_PRESSURE = 1.5
"""Greatest pressure of a patch up to which crosstalk is ignored [kPa]."""
NO_TAXELS = np.empty(0, np.int64)
MAX_OBSERVATIONS = 200
"""Number of latest observations whose median is the estimate."""
MAX_CELLS_PER_TAXEL, FREE_CELLS = 20, 1000
"""Largest number of crossings of the rows and columns of a patch for each of its
taxels, beyond some that are free."""
LOW_RANK = 0.1
"""Quantile of the counts above rest at which the lowest taxels of a patch lie: dead
ones may lie below."""
EVEN = 0.5
"""Ratio of this quantile to the median from which all taxels have drifted alike: under
a hand they differ more."""
AT_REST_SIGMAS = 4.0
"""Largest distance from rest of an untouched taxel, in units of its noise."""


@final
class KnownRest:
    """The counts of a skin at rest, as a calibration or earlier scans tell them.

    A hand may lie on a skin that is switched on. Its taxels lie above their rest, the
    others at it. The rest of a whole patch also drifts, by about the same for all
    taxels, and is another one where a patch was replaced.
    """

    def __init__(self, skin: Skin, calibration: Calibration) -> None:
        """Store rest and noise; a noise that is not known is taken as one count."""
        unknown = np.full(skin.count, np.nan)
        self.rest = unknown if calibration.rest is None else calibration.rest
        noise = np.ones(skin.count) if calibration.noise is None else calibration.noise
        self.near = AT_REST_SIGMAS * noise
        index = np.asarray(skin.patch_index)
        self.members = [np.flatnonzero(index == n) for n in range(len(skin.patches))]

    def compare(
        self, counts: Counts, use: Flags, margin: Values, adjacency: Adjacency
    ) -> tuple[Values, Flags]:
        """Return the rest of each taxel after drift, and where it is plausible.

        It is plausible where the counts lie at it, or above it by `margin`, from which
        a taxel may be touched, together with those of a neighbour. A taxel that is
        neither has an offset of its own. Taxels without `use` were not received or are
        faulty; NaN is no known rest.
        """
        rest = self.rest.copy()
        known = np.zeros(len(rest), bool)
        use = use & np.isfinite(rest)
        for members in self.members:
            seen = members[use[members]]
            if len(seen):
                drift = find_drift(counts[seen] - rest[seen], margin[seen])
                rest[seen] += drift or 0.0
                known[seen] = drift is not None
        above = counts - rest
        pressed = known & (above > margin)
        for i in np.flatnonzero(pressed):
            near = adjacency.neighbours[slice(*adjacency.starts[i : i + 2])]
            known[i] = pressed[near].any()
        return rest, known & (pressed | (np.abs(above) <= self.near))


def find_drift(
    above: Float[np.ndarray, "some"], margin: Float[np.ndarray, "some"]
) -> float | None:
    """Return the common drift of a patch [counts]; None for another rest.

    `above` are counts above the calibrated rest, `margin` those from which a taxel may
    be touched.
    """
    low, middle = np.quantile(above, (LOW_RANK, 0.5))
    limit = float(np.median(margin))
    if low < -limit:
        return None
    if low > limit:
        return None if low >= EVEN * middle else 0.0
    return float(np.median(above[above <= low + limit]))


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
        self.least_margin = calibration.compute_counts(self.config.margin)
        self.margin = self.least_margin
        self.noise: np.ndarray | None = None
        self.known_rest = KnownRest(skin, calibration)
        self.state = build_baseline_state(skin.count)
        # No taxel was last received before [s]; times of a taxel only grow.
        self.oldest = -np.inf
        self.context = BaselineContext(
            np.asarray(calibration.gain, np.float64),
            calibration.pressure_curve,
            self.adjacency,
            self.state,
            np.zeros((skin.count, self.config.tare_samples)),
            BaselineParameters(**vars(self.config)),
            TaxelGroups.build(skin, np.asarray(skin.rows)),
            TaxelGroups.build(skin, np.asarray(skin.columns)),
            np.zeros(skin.count),
            MATRIX_LINE_SHARE if calibration.matrix else 0.0,
        )
        self.shear_rest = np.full((skin.count, 2), float(calibration.shear_rest))
        self.first: int | None = None
        self.last: int | None = None

    def set_noise(self, counts: Values) -> None:
        """Set the counts above rest of each taxel up to which they are noise.

        A taxel may be touched from twice of it on.
        """
        if counts is not self.noise:
            self.noise = counts
            self.margin = np.maximum(self.least_margin, CLEAR_FACTOR * counts)

    def push(
        self,
        scan: Scan,
        faulty: Flags | None = None,
        latched: Int[np.ndarray, "latched"] | None = None,
    ) -> Reading:
        """Calibrate the next scan.

        Faulty taxels are not valid and not tracked; the baselines of `latched` ones,
        which were in contact at the last reading, stay.
        """
        check_count(scan, self.skin)
        check_order(self.last, scan.stamp)
        if self.first is None:
            self.first = scan.stamp
        seconds = (scan.stamp - self.first) / NS_PER_S
        elapsed = 0.0 if self.last is None else (scan.stamp - self.last) / NS_PER_S
        self.last = scan.stamp
        use = scan.received if faulty is None else scan.received & ~faulty
        self.start_from_rest(scan.counts, use, seconds)
        pressure = np.empty(self.skin.count, np.float32)
        calibrate(
            scan.counts,
            use,
            seconds,
            self.margin,
            NO_TAXELS if latched is None else latched,
            self.context,
            pressure,
        )
        shear = None
        if scan.shear is not None:
            shear = self.calibrate_shear(scan.shear, use, seconds, elapsed)
        return Reading(scan.stamp, pressure, use.copy(), scan.q, shear)

    @property
    def rest(self) -> Values:
        """Counts of each taxel at rest, its baseline."""
        return self.state["baseline"]

    @property
    def is_tared(self) -> Flags:
        """Which taxels have a baseline from a whole tare, or a calibrated rest."""
        return self.state["sample_count"] >= self.config.tare_samples

    def restart(self, taxels: Int[np.ndarray, "some"]) -> None:
        """Tare some taxels anew, as if they had not been received yet."""
        self.state["last_received"][taxels] = self.oldest = -np.inf
        self.state["sample_count"][taxels] = 0

    def start_from_rest(self, counts: Counts, use: Flags, seconds: float) -> None:
        """Start baselines from a known rest where a taxel has its first data.

        That is the calibrated one. After a long silence it is the rest before it. Where
        it is not plausible, the taxel is tared.
        """
        if seconds - self.oldest <= SILENCE_SECONDS:
            return
        state = self.state
        starts = use & (seconds - state["last_received"] > SILENCE_SECONDS)
        if not starts.any():
            self.oldest = float(state["last_received"].min())
            return
        known = self.known_rest
        known.rest = np.where(self.is_tared, self.rest, known.rest)
        rest, plausible = known.compare(counts, use, self.margin, self.adjacency)
        found = starts & plausible
        state["baseline"][found] = rest[found]
        state["sample_count"][found] = self.config.tare_samples
        state["peak"][found] = 0.0
        for name in ("touched_since", "low", "low_since"):
            state[name][found] = np.inf
        # They have been received, so the kernel does not tare them for their silence.
        state["last_received"][found] = seconds

    def calibrate_shear(
        self,
        counts: Int[np.ndarray, "taxel 2"],
        use: Flags,
        seconds: float,
        elapsed: float,
    ) -> Float[np.ndarray, "taxel 2"]:
        """Calibrate shear, and track its baseline while the taxel is untouched."""
        above = counts - self.shear_rest
        idle = use & (seconds - self.state["last_touched"] > self.config.freeze_seconds)
        step = elapsed / (self.config.drift_seconds + elapsed)
        self.shear_rest[idle] += step * above[idle]
        shear = (above * self.calibration.shear_gain).astype(np.float32)
        shear[~use] = 0.0
        return shear


def build_baseline_state(count: int) -> np.ndarray:
    """Build the state of a skin before its first scan, of dtype `BASELINE`."""
    state = np.zeros(count, BASELINE)
    for name in ("low", "low_since", "touched_since", "steady_level"):
        state[name] = np.inf
    for name in ("last_received", "last_touched", "steady_since", "next_sample"):
        state[name] = -np.inf
    return state


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
            np.zeros(2),
            np.zeros(2, np.int64),
            np.zeros((2, MAX_OBSERVATIONS)),
            np.zeros(MAX_OBSERVATIONS),
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
        row_sizes=np.bincount(rows),
        column_sizes=np.bincount(columns),
        half_scale=gain[taxels] * calibration.full_scale,
        shown=np.zeros(count),
        own=np.zeros(count),
        row_sums=np.zeros(shape[0]),
        column_sums=np.zeros(shape[1]),
        detours=np.zeros(count),
        shares=np.zeros(count),
    )
