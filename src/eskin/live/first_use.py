"""This module compiles and loads all code of a recogniser before its first scan."""

import atexit
import os
import subprocess
import sys

import numpy as np

from eskin.compiled import is_kept
from eskin.live.graph import NO_HISTORY
from eskin.live.graph_builder import NO_TAXELS, GraphBuilder, TouchNodes
from eskin.live.model_file import load_model
from eskin.live.network import LogitStream
from eskin.live.recognizer import Recognizer
from eskin.live.step_kernels import step
from eskin.skin import mount_skin
from eskin.touch import Calibration, Reading, Scan, TouchPipeline

WARM_UP_PERIOD = 20_000_000
"""Time between readings of `warm_up` [ns]."""
FIRST_TOUCHED = 120
"""Number of the first of its readings with a touch, which the network processes."""


def warm_up(recognizer: Recognizer) -> None:
    """Load all compiled code that a recogniser of this kind needs.

    Two others like it process a poke of one patch, one as readings, one as scans of a
    matrix behind a divider; the recogniser itself does not change. Where nothing is
    compiled, a second process compiles the network meanwhile.
    """
    helper = start_helper()
    model, mounted = recognizer.model, recognizer.mounted
    skin, robot = mounted.skin, mounted.robot
    pressed = np.arange(skin.count) < 4
    valid, q = np.ones(skin.count, bool), np.zeros(len(robot.joint_names))
    calibration = Calibration(
        np.full(skin.count, 0.1), 4000, curve="divider", exponent=0.8, matrix=True
    )
    reading_recognizer = Recognizer(model, mounted, None)
    scan_recognizer = Recognizer(model, mounted, calibration)
    shear = np.zeros((skin.count, 2), np.float32) if skin.has_shear else None
    shear_counts = None if shear is None else shear.astype(np.int32)
    for number in range(150):
        is_touched = FIRST_TOUCHED <= number < 135
        stamp, touched = number * WARM_UP_PERIOD, pressed & is_touched
        pressure = np.where(touched, 30.0, 0.0).astype(np.float32)
        reading = Reading(stamp, pressure, valid, q, shear)
        if number == FIRST_TOUCHED and helper is not None:
            TouchPipeline(mounted, calibration).push_reading(reading)
            helper.wait()
        reading_recognizer.push(reading)
        counts = np.where(touched, 300, 20).astype(np.int32)
        scan_recognizer.push(Scan(stamp, counts, valid, q, shear_counts))


def compile_network() -> None:
    """Compile the step of the network, whose types are the same for every model."""
    mounted = mount_skin("ur5")
    stream = LogitStream(load_model("ur5"), GraphBuilder(mounted))
    count, joints = mounted.skin.count, len(mounted.robot.joint_names)
    pressure, valid = np.zeros(count, np.float32), np.ones(count, bool)
    nodes = TouchNodes(NO_TAXELS, NO_TAXELS, NO_HISTORY)
    stream.push(Reading(0, pressure, valid, np.zeros(joints)), {1: nodes})


def start_helper() -> subprocess.Popen | None:
    """Start a process that runs `compile_network`, which ends with this one.

    Returns:
        The process; None where its result is kept on disk already, or where there is
        but one core.
    """
    if is_kept(step) or (os.cpu_count() or 1) < 2:
        return None
    code = f"from {__name__} import compile_network; compile_network()"
    helper = subprocess.Popen(
        [sys.executable, "-P", "-c", code],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    atexit.register(helper.kill)
    return helper
