"""`eskin doctor` checks the installation and compiles the code that eskin needs."""

import importlib.metadata
import math
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path

from numba.core import event

from eskin.app import SourceConfig, open_source
from eskin.drivers import (
    DeviceSource,
    ScanRateMeter,
    SerialPortInfo,
    list_serial_ports,
    read_key,
)
from eskin.errors import DeviceError, EskinError
from eskin.live import MODELS, Recognizer, warm_up

RUNTIME_PACKAGES = ("numpy", "scipy", "numba", "mcap", "pydantic", "pyserial")
TRAINING_PACKAGES = ("torch", "scikit-learn")


LISTEN_NS = 3_000_000_000
"""Time for which patches are observed [ns]."""
MAX_AGE_S = 0.5
"""Age of the last scan from which a patch is silent [s]."""
MIN_RATE_SHARE = 0.8
"""Share of its nominal rate below which a patch is slow."""


@dataclass(frozen=True)
class DoctorCommand:
    """Check the installation, and compile all code that the recogniser needs.

    Compiled code is kept on disk, so that later no program waits for the compiler. With
    --source, the command also observes patches for three seconds and reports their
    rates.
    """

    source: tuple[str, ...] = ()
    """Source of the patches: serial:PATH (one or several) or udp://HOST:PORT."""

    skin: str | None = None
    """Skin of the patches given by --source: a preset's name or a skin's folder."""

    robot_urdf: str | None = None
    """Robot that this skin is mounted on; preset skins have their own."""

    key: Path | None = None
    """Key file of the patches; packets without a valid seal are refused."""


@dataclass(frozen=True)
class Check:
    """A check has a name and tells whether it passed and what it found."""

    name: str
    """Name of what was checked."""

    ok: bool
    """Whether the check passed."""

    found: str
    """Description of what was found, with a remedy if the check failed."""


def run(command: DoctorCommand) -> dict[str, object]:
    """Run all checks and print one line for each; raise if any check fails."""
    checks = []
    for check in chain(run_checks(), check_patches(command)):
        print(f"{'ok' if check.ok else 'WRONG':6}{check.name}: {check.found}")
        checks.append(check)
    wrong = [check.name for check in checks if not check.ok]
    if wrong:
        raise EskinError(f"checks failed: {', '.join(wrong)}; see above")
    return {"checks": [asdict(check) for check in checks]}


def run_checks() -> Iterator[Check]:
    """Yield the results of the checks of the installation."""
    yield Check("python", True, platform.python_version())
    yield Check("packages", True, ", ".join(list_versions(RUNTIME_PACKAGES)))
    missing = "not installed; only training needs it: pip install '.[train]'"
    yield Check(
        "for training", True, ", ".join(list_versions(TRAINING_PACKAGES)) or missing
    )
    yield from check_ports(list_serial_ports())
    for model in MODELS:
        yield run_check(f"weights {model}", lambda model=model: check_model(model))


def check_ports(ports: Sequence[SerialPortInfo]) -> Iterator[Check]:
    """Check the serial ports; a port without permission needs membership of a group."""
    if not ports:
        yield Check("serial ports", True, "none; a patch may be plugged in any time")
    for port in ports:
        remedy = "may not be used: sudo usermod -aG dialout $USER, then log in anew"
        found = port.description if port.usable else f"{port.description}; {remedy}"
        yield Check(f"serial port {port.path}", port.usable, found)


def check_patches(command: DoctorCommand) -> Iterator[Check]:
    """Check rate and age of the scans of the patches that were asked about."""
    if not command.source:
        return
    key = None if command.key is None else read_key(command.key)
    config = SourceConfig(command.skin, command.robot_urdf, key=key)
    with open_source(*command.source, config=config) as source:
        if not isinstance(source, DeviceSource):
            raise DeviceError(
                f"--source is {' '.join(command.source)}; allowed are devices, "
                "serial:PATH or udp://HOST:PORT; correct it"
            )
        end = source.clock.now() + LISTEN_NS
        while source.clock.now() < end:
            source.read(0.1)
        ages = source.assembler.ages(source.clock.now())
        paces = {
            stream.slot.patch.id: stream.rate_meter
            for stream in source.assembler.streams.values()
        }
        yield from (
            check_patch(patch, paces[patch], age) for patch, age in ages.items()
        )


def check_patch(patch: str, pace: ScanRateMeter, age: float) -> Check:
    """Check the rate and the age [s] of the scans of one patch."""
    name = f"patch {patch}"
    if age > MAX_AGE_S:
        silence = "no scans received" if math.isinf(age) else f"silent for {age:.1f} s"
        return Check(name, False, f"{silence}; check cable, address and power")
    measured = pace.measured or 0.0
    found = f"{measured:.1f} scans a second, {1e3 * age:.0f} ms old"
    slow = measured < MIN_RATE_SHARE * pace.nominal
    remedy = f"; its nominal rate is {pace.nominal}: check its line and power"
    return Check(name, not slow, found + remedy * slow)


def list_versions(packages: tuple[str, ...]) -> Iterator[str]:
    """Yield those of the packages that are installed, with their versions."""
    for package in packages:
        try:
            yield f"{package} {importlib.metadata.version(package)}"
        except importlib.metadata.PackageNotFoundError:
            continue


def run_check(name: str, look: Callable[[], str]) -> Check:
    """Return the result of a check, which fails if it raises an error."""
    try:
        return Check(name, True, look())
    except (EskinError, ValueError, OSError) as error:
        return Check(name, False, f"{error}; install eskin again")


def check_model(model: str) -> str:
    """Push scans and readings through a recogniser, so that all of it is compiled."""
    started = time.monotonic()
    with event.install_recorder("numba:compile") as compiled:
        warm_up(Recognizer.load(model))
    seconds = f"{time.monotonic() - started:.1f} s"
    if compiled.buffer:
        return f"recognises; compiled now in {seconds}, kept on disk"
    return f"recognises; compiled code was ready, loaded in {seconds}"
