"""A recording in memory, calibrated, as it is played."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Float16, Int

from eskin.errors import RecordingError
from eskin.recording import Recording
from eskin.touch import Calibrator
from eskin.units import NS_PER_S


@dataclass(frozen=True, eq=False)
class Take:
    """Every reading of a recording."""

    seconds: Float[np.ndarray, "reading"]
    """Since the first reading [s]."""

    pressure: Float16[np.ndarray, "reading taxel"]
    """[kPa]; zero where it is not believed."""

    valid: Bool[np.ndarray, "reading taxel"]
    """Which taxels are believed."""

    q: Float[np.ndarray, "reading joint"]
    """Joint positions [rad]."""

    force: Float[np.ndarray, "reading"]
    """Of the whole skin [N]."""

    peak: Float[np.ndarray, "reading"]
    """Greatest pressure [kPa]."""

    def at(self, seconds: float) -> int:
        """The latest reading at a time [s]; the first where there is none yet."""
        return max(int(np.searchsorted(self.seconds, seconds, "right")) - 1, 0)


def read_take(recording: Recording) -> Take:
    """Read and calibrate every scan.

    Raises:
        RecordingError: there is none.
    """
    if not recording.count:
        raise RecordingError(
            f"{recording.path} holds no scans; allowed is one or more; give another"
        )
    calibrator = Calibrator(recording.skin, recording.calibration)
    areas = 1e3 * recording.skin.areas
    taxels, joints = recording.skin.count, len(recording.joint_names)
    seconds, q = np.empty(recording.count), np.empty((recording.count, joints))
    pressure = np.zeros((recording.count, taxels), np.float16)
    valid = np.zeros((recording.count, taxels), np.bool_)
    force, peak = np.zeros(recording.count), np.zeros(recording.count)
    count = 0
    for count, scan in enumerate(recording.scans(), 1):
        reading = calibrator.push(scan)
        row = count - 1
        believed = np.where(reading.valid, np.maximum(reading.pressure, 0.0), 0.0)
        seconds[row] = (reading.stamp - recording.start) / NS_PER_S
        pressure[row], valid[row], q[row] = believed, reading.valid, reading.q
        force[row], peak[row] = believed @ areas, believed.max()
    rows = slice(count)
    return Take(
        seconds[rows], pressure[rows], valid[rows], q[rows], force[rows], peak[rows]
    )


def envelope(
    values: Float[np.ndarray, "reading"], bins: int
) -> Float[np.ndarray, "bin"]:
    """The greatest value of each of equal parts; as many as there are, at most."""
    bins = min(bins, len(values))
    edges: Int[np.ndarray, bin] = np.linspace(0, len(values), bins, endpoint=False)
    return np.maximum.reduceat(values, edges.astype(np.int64))
