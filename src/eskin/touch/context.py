"""This module defines what the kernels of the front end are given."""

from typing import Any, NamedTuple

import numpy as np

from eskin.touch.pressure_kernels import PressureCurve
from eskin.touch.taxels import TaxelPlaces


class KernelScan(NamedTuple):
    """A scan is passed to the kernels in this form."""

    now: float
    """Time since the first scan, `Instant.now` [s]."""
    elapsed: float
    """Time since the last scan, `Instant.elapsed` [s]. Kernels are given these numbers
    alone, since an instant in a tuple takes 2 us longer at each call."""
    counts: np.ndarray
    """(taxel) counts."""
    received: np.ndarray
    """(taxel) whether the counts are new, and of no outage."""
    heard: np.ndarray
    """(taxel) the same, with outages."""
    used: np.ndarray
    """(taxel) whether the counts are new, of no outage and of no faulty taxel."""
    starts: np.ndarray
    """(taxel) whether rest begins anew with the counts; written by `check_patches`."""
    faulty: np.ndarray
    """(taxel) which taxels are faulty; those with negative counts are added."""


class Crosstalk(NamedTuple):
    """This tuple holds the crosstalk of a device, with the buffers of its kernels.

    Conductances are relative to those at half scale, or at full scale of a linear
    device.
    """

    shown: np.ndarray
    """(taxel) measured conductance."""
    own: np.ndarray
    """(taxel) conductance without crosstalk."""
    detours: np.ndarray
    """(taxel) conductance of the paths over three others."""
    shares: np.ndarray
    """(taxel) ratios of the conductance of a taxel to the conductance of others."""
    row_sums: np.ndarray
    """(row) sums of conductances."""
    column_sums: np.ndarray
    """(column) sums of conductances."""
    value: np.ndarray
    """(coefficient) estimated coefficients, medians of the latest observations."""
    seen: np.ndarray
    """(coefficient) number of observations so far."""
    observed: np.ndarray
    """(coefficient, observation) the latest observations in turn."""
    ranked: np.ndarray
    """(observation) space to rank them."""


class FrontEndContext(NamedTuple):
    """A context holds the arguments of the kernels that are kept between scans."""

    full_scale: float
    """Counts at which the converter saturates."""
    curve: PressureCurve
    """Relation of pressure and counts."""
    line_share: float
    """Largest share of the counts of a touched taxel on the others of its row, and of
    its column; 0 where taxels are not read out by rows and columns."""
    places: TaxelPlaces
    """Where each taxel is, and to what it belongs."""
    constants: np.ndarray
    """(taxel) TAXEL_CONSTANTS."""
    taxels: np.ndarray
    """(taxel) TAXEL, which is updated."""
    patches: np.ndarray
    """(patch) PATCH, which is updated."""
    crosstalk: Crosstalk
    """Crosstalk, which is updated."""
    samples: np.ndarray
    """(taxel, sample) samples of the tare, ascending, updated."""
    rest: Any
    """`RestParameters`."""
    faults: Any
    """`FaultParameters`."""
