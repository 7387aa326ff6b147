"""`eskin doctor`: what is installed, whether it works, and compiled code made ready."""

import importlib.metadata
import platform
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass

import numpy as np
from numba.core import event

from eskin.errors import EskinError
from eskin.live import Recognizer
from eskin.model import MODELS
from eskin.touch import Calibration, Reading, Scan

USED = ("numpy", "scipy", "numba", "mcap", "pydantic")
FOR_TRAINING = ("torch", "scikit-learn")
PERIOD = 20_000_000
"""Between readings [ns]."""


@dataclass(frozen=True)
class Command:
    """Check the installation, and compile all that the recogniser needs.

    Compiled code is kept on disk: after this, no program waits for the compiler.
    """


@dataclass(frozen=True)
class Check:
    """One thing looked at."""

    name: str
    """What."""

    ok: bool
    """Whether it is as it should be."""

    found: str
    """What was found, and what to do where it is not."""


def run(command: Command) -> dict[str, object]:
    """Check everything, one line a check; raise where something is wrong."""
    checks = []
    for check in every_check():
        print(f"{'ok' if check.ok else 'WRONG':6}{check.name}: {check.found}")
        checks.append(check)
    wrong = [check.name for check in checks if not check.ok]
    if wrong:
        raise EskinError(f"not as it should be: {', '.join(wrong)}; see above")
    return {"checks": [asdict(check) for check in checks]}


def every_check() -> Iterator[Check]:
    """Look at one thing after the other."""
    yield Check("python", True, platform.python_version())
    yield Check("packages", True, ", ".join(versions(USED)))
    missing = "not installed; only training needs it: pip install 'eskin[train]'"
    yield Check("for training", True, ", ".join(versions(FOR_TRAINING)) or missing)
    for model in MODELS:
        yield attempt(f"weights {model}", lambda model=model: recognises(model))


def versions(packages: tuple[str, ...]) -> Iterator[str]:
    """Those of the packages that are installed, with their versions."""
    for package in packages:
        try:
            yield f"{package} {importlib.metadata.version(package)}"
        except importlib.metadata.PackageNotFoundError:
            continue


def attempt(name: str, look: Callable[[], str]) -> Check:
    """What a look finds, or why it failed."""
    try:
        return Check(name, True, look())
    except (EskinError, ValueError, OSError) as error:
        return Check(name, False, f"{error}; install eskin again")


def recognises(model: str) -> str:
    """Push scans and readings through a recogniser, so that all of it is compiled."""
    started = time.monotonic()
    with event.install_recorder("numba:compile") as compiled:
        touch(Recognizer.load(model))
    seconds = f"{time.monotonic() - started:.1f} s"
    if compiled.buffer:
        return f"recognises; compiled now in {seconds}, kept on disk"
    return f"recognises; compiled code was ready, loaded in {seconds}"


def touch(recognizer: Recognizer) -> None:
    """A poke of one patch, as readings, then as scans of a matrix and a divider."""
    skin, robot = recognizer.mounted.skin, recognizer.mounted.robot
    pressed = np.arange(skin.count) < 4
    everywhere, q = np.ones(skin.count, bool), np.zeros(len(robot.joint_names))
    calibration = Calibration(
        np.full(skin.count, 0.1), 4000, curve="divider", exponent=0.8, matrix=True
    )
    of_scans = Recognizer(recognizer.model, recognizer.mounted, calibration)
    for number in range(150):
        stamp, down = number * PERIOD, 120 <= number < 135
        pressure = np.where(pressed & down, 30.0, 0.0).astype(np.float32)
        recognizer.push(Reading(stamp, pressure, everywhere, q))
        counts = np.where(pressed & down, 300, 20).astype(np.int32)
        of_scans.push(Scan(stamp, counts, everywhere, q))
