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
from eskin.touch import Reading, warm_up_touches
from eskin.touch.first_use import build_matrix_calibration, make_poke


def warm_up(recognizer: Recognizer) -> None:
    """Load all compiled code that a recogniser of this kind needs.

    The recogniser itself does not change: another one like it processes a poke. Where
    nothing is compiled, a second process compiles the network meanwhile.
    """
    helper = start_helper()
    mounted = recognizer.mounted
    warm_up_touches(mounted)
    if helper is not None:
        helper.wait()
    other = Recognizer(recognizer.model, mounted, build_matrix_calibration(mounted))
    for scan in make_poke(mounted):
        other.push(scan)


def compile_network() -> None:
    """Compile the step of the network, whose types are the same for every model."""
    mounted = mount_skin("ur5")
    stream = LogitStream(load_model("ur5"), GraphBuilder(mounted))
    count = mounted.skin.count
    joints = len(mounted.robot.joint_names)
    pressure = np.zeros(count, np.float32)
    valid = np.ones(count, bool)
    nodes = TouchNodes(NO_TAXELS, NO_TAXELS, NO_HISTORY)
    stream.compute_logits(Reading(0, pressure, valid, np.zeros(joints)), {1: nodes})


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
