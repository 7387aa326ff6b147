"""This module turns scans into readings, and finds faults."""

from dataclasses import replace
from typing import final

import numpy as np
from jaxtyping import Bool, Float, Int

from eskin.compiled import pack
from eskin.skin import Skin
from eskin.touch.calibration import MAX_CONTACT, Calibration
from eskin.touch.context import Crosstalk, FrontEndContext, KernelScan
from eskin.touch.crosstalk_kernels import CROSSTALK, GHOST, LEAK, compensate
from eskin.touch.fault_kernels import (
    NOISY,
    FaultConfig,
    FaultParameters,
    check_faults,
    follow_faults,
)
from eskin.touch.faults import Fault, list_faults
from eskin.touch.known_rest import AT_REST_SIGMAS, find_known_rest
from eskin.touch.noise_kernels import BAND, begin_taxels
from eskin.touch.outage_kernels import check_patches
from eskin.touch.polarity import PolarityDetector
from eskin.touch.reading import Reading, Scan, check_count
from eskin.touch.records import ContactConfig
from eskin.touch.rest_kernels import (
    MATRIX_LINE_SHARE,
    CalibrationConfig,
    RestParameters,
    follow_rest,
)
from eskin.touch.taxel_kernels import NEVER, NO_FAULT, reset_rest
from eskin.touch.taxels import (
    TAXEL_CONSTANTS,
    Instant,
    ReadingClock,
    TaxelPlaces,
    build_patches,
    build_taxels,
)

Flags = Bool[np.ndarray, "taxel"]
Values = Float[np.ndarray, "taxel"]
Counts = Int[np.ndarray, "taxel"]

MAX_OBSERVATIONS = 200
"""Number of latest observations of crosstalk whose median is the estimate."""


@final
class FrontEnd:
    """A front end turns the scans of one skin into readings; stateful.

    The result depends only on the scans and their stamps, so a recording that is
    replayed at any rate gives the same readings as the live device. Each scan passes
    the kernels in the order of the model: outages, rest, noise, faults, crosstalk.

    A fault needs clear signs: constant counts of a quiet, quantised sensor, and zero
    where zero is rest, are valid until other taxels show that they should have changed.

    Attributes:
        taxels: (taxel) `TAXEL`.
        mask: which taxels are faulty.
        doubtful: which are faulty, or show signs of a fault.
        taxel_faults: faults of taxels, with a whole row, column or patch as one.
        faults: the same, and a fault of a patch whose counts go another way than they
            are taken to.
    """

    def __init__(
        self,
        skin: Skin,
        calibration: Calibration,
        config: CalibrationConfig | None = None,
        faults: FaultConfig | None = None,
    ) -> None:
        """Start before the first scan.

        Args:
            skin: the skin.
            calibration: constants of its electronics.
            config: how rest is followed.
            faults: how clear the signs of a fault must be.

        Raises:
            SkinMismatchError: the calibration is of another skin.
        """
        calibration.check_skin(skin)
        self.skin = skin
        self.calibration = calibration.rising
        self.is_falling = calibration.falling
        self.config = config or CalibrationConfig()
        self.clock = ReadingClock()
        self.places = TaxelPlaces.build(skin)
        self.constants = build_constants(self.calibration)
        self.taxels = build_taxels(skin.count)
        begin_taxels(self.constants, self.taxels)
        known = self.calibration.rest
        self.taxels["known_rest"] = np.nan if known is None else known
        self.patches = build_patches(len(skin.patches))
        self.crosstalk = build_crosstalk(skin.count, self.places)
        self.fault_config = faults or FaultConfig()
        self.context = pack(
            FrontEndContext(
                full_scale=float(self.calibration.full_scale),
                curve=self.calibration.pressure_curve,
                line_share=MATRIX_LINE_SHARE if calibration.matrix else 0.0,
                places=self.places,
                constants=self.constants,
                taxels=self.taxels,
                patches=self.patches,
                crosstalk=self.crosstalk,
                samples=np.zeros((skin.count, self.config.tare_samples)),
                rest=RestParameters(**vars(self.config)),
                faults=FaultParameters(**vars(self.fault_config)),
            )
        )
        self.polarity = PolarityDetector(
            skin,
            self.places,
            self.taxels,
            "rising" if self.is_falling else "falling",
            self.calibration.full_scale,
            self.constants["clear"],
        )
        self.shear_rest = np.full((skin.count, 2), float(calibration.shear_rest))
        self.last_check = NEVER
        self.mask = np.zeros(skin.count, np.bool_)
        self.doubtful = np.zeros(skin.count, np.bool_)
        self.taxel_faults: tuple[Fault, ...] = ()
        self.faults: tuple[Fault, ...] = ()

    def make_reading(self, scan: Scan) -> Reading:
        """Return the reading of the next scan.

        Data that cannot be trusted is not valid in it. The rest of taxels stays that
        were clearly pressed at the last reading.

        Raises:
            ReadingError: the scan is of another skin, or not later than the last one.
                The state is then unchanged.
        """
        check_count(scan, self.skin)
        instant = self.clock.advance_to(scan.stamp)
        scan = self.turn(scan)
        # Faults need the pressure of this scan, so taxels are masked by those of the
        # last one; negative counts are invalid at once.
        invalid = self.mask | (scan.counts < 0)
        received = scan.received.copy()
        kernel_scan = KernelScan(
            now=instant.now,
            elapsed=instant.elapsed,
            counts=scan.counts,
            received=received,
            heard=scan.received,
            used=received & ~invalid,
            starts=np.empty(self.skin.count, np.bool_),
            faulty=self.mask.copy(),
        )
        if check_patches(kernel_scan, self.context):
            self.start_from_rest(kernel_scan)
        pressure = np.empty(self.skin.count, np.float32)
        follow_rest(kernel_scan, self.context, pressure)
        follow_faults(kernel_scan, self.context)
        self.mask = kernel_scan.faulty
        if instant.now - self.last_check >= self.fault_config.check_seconds - 1e-6:
            self.update_faults(kernel_scan, pressure, instant)
        valid = kernel_scan.used & ~self.mask
        shear = None
        if scan.shear is not None:
            shear = self.calibrate_shear(scan.shear, kernel_scan)
        self.compensate(pressure, valid)
        polarity = self.polarity.check_polarity(scan, instant, self.mask)
        self.faults = self.taxel_faults + polarity
        return Reading(scan.stamp, pressure, valid, scan.q, shear)

    def turn(self, scan: Scan) -> Scan:
        """Return a scan whose counts rise under pressure."""
        if not self.is_falling:
            return scan
        return replace(scan, counts=self.calibration.turn_counts(scan.counts))

    def update_faults(
        self,
        scan: KernelScan,
        pressure: Float[np.ndarray, "taxel"],
        instant: Instant,
    ) -> None:
        """Check the signs of faults, and list them."""
        config = self.fault_config
        now = instant.now
        elapsed = min(now - self.last_check, 2.0 * config.check_seconds)
        check_faults(scan, pressure, self.last_check, elapsed, self.context)
        self.last_check = now
        doubted = now - self.taxels["last_doubted"] <= config.recover_seconds
        self.doubtful = doubted | self.mask
        received = np.maximum(self.taxels["last_received"], 0.0)
        silent = now - received >= config.line_seconds
        self.taxel_faults = ()
        if self.mask.any() or silent.any():
            code = self.taxels["code"].copy()
            code[(code == NO_FAULT) & self.mask] = NOISY
            since = np.where(self.mask, self.taxels["since"], received)
            found = list_faults(self.skin, self.places, code, silent, since, instant)
            self.taxel_faults = tuple(found)

    def start_from_rest(self, scan: KernelScan) -> None:
        """Start rest from known counts where it begins anew.

        That is the calibrated rest, or after a long silence the rest before it. Where
        it is not plausible, the taxel is tared.
        """
        taxels = self.taxels
        starts = scan.starts
        taxels["known_rest"][self.is_tared] = self.rest[self.is_tared]
        rest, plausible = find_known_rest(
            scan.counts, scan.used, taxels, self.constants, self.places
        )
        for i in np.flatnonzero(starts):
            reset_rest(i, taxels)
        found = starts & plausible
        taxels["last_used"][starts] = scan.now
        taxels["rest"][found] = rest[found]
        taxels["sample_count"][starts] = 0
        taxels["sample_count"][found] = self.config.tare_samples

    def calibrate_shear(
        self, counts: Int[np.ndarray, "taxel 2"], scan: KernelScan
    ) -> Float[np.ndarray, "taxel 2"]:
        """Return the shear [kPa], and follow its rest while the taxel is untouched."""
        above = counts - self.shear_rest
        age = scan.now - self.taxels["last_touched"]
        idle = scan.used & (age > self.config.freeze_seconds)
        step = scan.elapsed / (self.config.drift_seconds + scan.elapsed)
        self.shear_rest[idle] += step * above[idle]
        shear = (above * self.calibration.shear_gain).astype(np.float32)
        shear[~scan.used] = 0.0
        return shear

    def compensate(self, pressure: Float[np.ndarray, "taxel"], valid: Flags) -> None:
        """Remove crosstalk from pressures [kPa], and learn from them how much it is."""
        is_matrix = self.calibration.matrix
        if is_matrix and pressure.max() > CROSSTALK.min_pressure:
            pressure[~valid] = 0.0
            compensate(pressure, valid, self.context)

    @property
    def rest(self) -> Values:
        """Counts of each taxel at rest."""
        return self.taxels["rest"]

    @property
    def is_tared(self) -> Flags:
        """Which taxels have a rest from a whole tare, or a calibrated one."""
        return self.taxels["sample_count"] >= self.config.tare_samples

    @property
    def floor(self) -> Values:
        """Pressure of each taxel up to which it may be noise [kPa]."""
        return self.taxels["floor"]

    @property
    def leak(self) -> float:
        """Apparent conductance of a taxel over the sum of the others of its lines."""
        return float(self.crosstalk.value[LEAK])

    @property
    def ghost(self) -> float:
        """Apparent conductance of a taxel over its detours over three others."""
        return float(self.crosstalk.value[GHOST])


def build_constants(calibration: Calibration) -> np.ndarray:
    """Build the constants (taxel) of a skin, of dtype `TAXEL_CONSTANTS`."""
    constants = np.zeros(len(calibration.gain), TAXEL_CONSTANTS)
    on = ContactConfig().with_floor(calibration.floor).on
    contact = calibration.compute_contact(on)
    constants["gain"] = calibration.gain
    constants["contact"] = contact
    constants["clear"] = calibration.compute_counts(BAND.clear_factor * on)
    constants["least_noise"] = np.clip(
        BAND.least_contacts * contact, *BAND.least_counts
    )
    # A noise that is not known is taken as one count.
    constants["near_rest"] = AT_REST_SIGMAS
    if calibration.noise is not None:
        constants["near_rest"] = AT_REST_SIGMAS * calibration.noise
        most = MAX_CONTACT * calibration.full_scale / BAND.noise_sigmas
        constants["start_noise"] = np.minimum(calibration.noise, most)
    return constants


def build_crosstalk(count: int, places: TaxelPlaces) -> Crosstalk:
    """Build the crosstalk of a device of some taxels of which nothing is known."""
    return Crosstalk(
        shown=np.zeros(count),
        own=np.zeros(count),
        detours=np.zeros(count),
        shares=np.zeros(count),
        row_sums=np.zeros(len(places.rows.sizes)),
        column_sums=np.zeros(len(places.columns.sizes)),
        value=np.zeros(2),
        seen=np.zeros(2, np.int64),
        observed=np.zeros((2, MAX_OBSERVATIONS)),
        ranked=np.zeros(MAX_OBSERVATIONS),
    )
