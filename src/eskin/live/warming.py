"""Everything that is compiled made ready before the first scan comes."""

import numpy as np

from eskin.live.recognizer import Recognizer
from eskin.touch import Calibration, Reading, Scan

PERIOD = 20_000_000
"""Between readings [ns]."""


def warm_up(recognizer: Recognizer) -> None:
    """Load all compiled code that a recogniser of this kind needs.

    A poke of one patch goes through others like it, as readings and as scans of a
    matrix behind a divider; the recogniser itself hears nothing of it.
    """
    model, mounted = recognizer.model, recognizer.mounted
    skin, robot = mounted.skin, mounted.robot
    pressed = np.arange(skin.count) < 4
    everywhere, q = np.ones(skin.count, bool), np.zeros(len(robot.joint_names))
    calibration = Calibration(
        np.full(skin.count, 0.1), 4000, curve="divider", exponent=0.8, matrix=True
    )
    of_readings = Recognizer(model, mounted, None)
    of_scans = Recognizer(model, mounted, calibration)
    shear = np.zeros((skin.count, 2), np.float32) if skin.has_shear else None
    shear_counts = None if shear is None else shear.astype(np.int32)
    for number in range(150):
        stamp, down = number * PERIOD, 120 <= number < 135
        pressure = np.where(pressed & down, 30.0, 0.0).astype(np.float32)
        of_readings.push(Reading(stamp, pressure, everywhere, q, shear))
        counts = np.where(pressed & down, 300, 20).astype(np.int32)
        of_scans.push(Scan(stamp, counts, everywhere, q, shear_counts))
