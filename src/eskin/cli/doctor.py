"""`eskin doctor` checks the installation and compiles the code that eskin needs."""

import importlib.metadata
import math
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from itertools import chain

from numba.core import event

from eskin.app import find_driver
from eskin.cli.guided import SourceCommand, open_guided_source
from eskin.drivers import (
    SerialPortInfo,
    SourceInfo,
    list_serial_ports,
    observe_source,
)
from eskin.errors import DeviceError, EskinError
from eskin.live import MODELS, Recognizer, warm_up
from eskin.registry import (
    GROUPS,
    advise_install,
    find_plugins,
    load_plugin,
    name_package,
)

RUNTIME_PACKAGES = ("numpy", "scipy", "numba", "mcap", "pydantic", "pyserial")
TRAINING_PACKAGES = ("torch", "scikit-learn")


LISTEN_SECONDS = 3.0
"""Shortest time for which patches are observed [s]."""
LISTEN_PERIODS = 10
"""Smallest number of periods of a source for which its patches are observed."""
MAX_AGE_S = 0.5
"""Age of the last scan up to which no patch is silent [s]."""
MAX_AGE_PERIODS = 3
"""Age of the last scan, in periods of a source, up to which no patch is silent."""
MIN_RATE_SHARE = 0.8
"""Share of its nominal rate below which a patch is slow."""


@dataclass(frozen=True, kw_only=True)
class DoctorCommand(SourceCommand):
    """Check the installation, and compile all code that live commands need.

    Compiled code is kept on disk, so that later no program waits for the compiler. With
    --source, the command also observes patches for three seconds, or ten scans where
    they are slower, and reports their rates.
    """

    source: tuple[str, ...] = ()
    """Source of the patches: serial:PATH or csv:PATH (one or several), udp://HOST:PORT
    or xela://HOST:PORT."""


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
    missing = f"not installed; only training needs it: {advise_install('train')}"
    yield Check(
        "for training", True, ", ".join(list_versions(TRAINING_PACKAGES)) or missing
    )
    yield from map(check_plugins, GROUPS)
    yield from check_ports(list_serial_ports())
    for model in MODELS:
        yield run_check(f"weights {model}", lambda model=model: check_model(model))


def check_plugins(group: str) -> Check:
    """List the entry points of a group; load the ones of other packages than eskin."""
    found = []
    ok = True
    for name, entry in find_plugins(group).items():
        if entry.module.startswith("eskin."):
            found.append(name)
            continue
        try:
            load_plugin(group, name)
            found.append(f"{name} ({name_package(entry)})")
        except EskinError as error:
            found.append(str(error))
            ok = False
    return Check(group.removeprefix("eskin."), ok, ", ".join(found))


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
    if not find_driver(command.source).is_device:
        raise DeviceError(
            f"--source is {' '.join(command.source)}; allowed are devices, as "
            "serial:PATH, csv:PATH or udp://HOST:PORT"
        )
    with ExitStack() as stack:
        source, _ = open_guided_source(command, stack)
        seconds = max(LISTEN_SECONDS, LISTEN_PERIODS / source.info.rate)
        observed = observe_source(source, seconds)
        events = source.take_events()
    broken = "; ".join(observed.problems)
    yield Check("driver", not broken, broken or "keeps the rules of sources")
    rates = observed.rates.tolist()
    ages = observed.ages.tolist()
    damaged = "; ".join(event.text for event in events if event.kind == "damaged")
    if damaged and all(map(math.isinf, ages)):
        yield Check("data", False, damaged)
    found = zip(source.info.skin.patches, rates, ages, strict=True)
    yield from (
        check_patch(patch.id, rate, age, source.info) for patch, rate, age in found
    )


def check_patch(patch: str, rate: float, age: float, info: SourceInfo) -> Check:
    """Check the rate [1/s] and the age [s] of the scans of one patch."""
    name = f"patch {patch}"
    if age > max(MAX_AGE_S, MAX_AGE_PERIODS / info.rate):
        silence = "no scans received" if math.isinf(age) else f"silent for {age:.1f} s"
        return Check(name, False, f"{silence}; check cable, address and power")
    found = f"{rate:.1f} scans a second, {1e3 * age:.0f} ms old"
    slow = rate < MIN_RATE_SHARE * info.rate
    remedy = f"; its nominal rate is {info.rate:g}: check its line and power" * slow
    return Check(name, not slow, found + remedy)


def list_versions(packages: tuple[str, ...]) -> Iterator[str]:
    """Yield the installed ones of the packages, with their versions."""
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
