"""`eskin doctor`: what is installed, whether it works, and compiled code made ready."""

import importlib.metadata
import math
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from itertools import chain

from numba.core import event

from eskin.app import SourceConfig, open_source
from eskin.drivers import DeviceSource, ScanRateMeter, SerialPortInfo, list_serial_ports
from eskin.errors import DeviceError, EskinError
from eskin.live import Recognizer, warm_up
from eskin.model import MODELS

USED = ("numpy", "scipy", "numba", "mcap", "pydantic", "pyserial")
FOR_TRAINING = ("torch", "scikit-learn")


LISTEN = 3_000_000_000
"""How long patches are listened to [ns]."""
OLDEST = 0.5
"""Age from which a patch is silent [s]."""
SLOW = 0.8
"""Share of what it promises below which a patch is slow."""


@dataclass(frozen=True)
class Command:
    """Check the installation, and compile all that the recogniser needs.

    Compiled code is kept on disk: after this, no program waits for the compiler. With
    --source it also listens to patches for three seconds and tells how each fares.
    """

    source: tuple[str, ...] = ()
    """Patches to listen to: serial:PATH, of several ports too, or udp://HOST:PORT."""

    skin: str | None = None
    """With --source, whose patches they are: a preset's name or a skin's folder."""

    robot_urdf: str | None = None
    """With --source, the robot that the skin is on; a preset skin has its own."""


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
    for check in chain(every_check(), patch_checks(command)):
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
    yield from port_checks(list_serial_ports())
    for model in MODELS:
        yield attempt(f"weights {model}", lambda model=model: recognises(model))


def port_checks(ports: Sequence[SerialPortInfo]) -> Iterator[Check]:
    """What is plugged in; a port that may not be used needs its group."""
    if not ports:
        yield Check("serial ports", True, "none; a patch may be plugged in any time")
    for port in ports:
        remedy = "may not be used: sudo usermod -aG dialout $USER, then log in anew"
        found = port.description if port.usable else f"{port.description}; {remedy}"
        yield Check(f"serial port {port.path}", port.usable, found)


def patch_checks(command: Command) -> Iterator[Check]:
    """How the patches fare that were asked about: rate, and age of what they sent."""
    if not command.source:
        return
    config = SourceConfig(command.skin, command.robot_urdf)
    with open_source(*command.source, config=config) as source:
        if not isinstance(source, DeviceSource):
            raise DeviceError(
                f"--source is {' '.join(command.source)}; allowed are devices, "
                "serial:PATH or udp://HOST:PORT; correct it"
            )
        end = source.clock.now() + LISTEN
        while source.clock.now() < end:
            source.read(0.1)
        ages = source.assembler.ages(source.clock.now())
        paces = {
            stream.slot.patch.id: stream.rate_meter
            for stream in source.assembler.streams.values()
        }
        yield from (check_of(patch, paces[patch], age) for patch, age in ages.items())


def check_of(patch: str, pace: ScanRateMeter, age: float) -> Check:
    """How one patch fares."""
    name = f"patch {patch}"
    if age > OLDEST:
        heard = "not heard" if math.isinf(age) else f"silent for {age:.1f} s"
        return Check(name, False, f"{heard}; check cable, address and power")
    measured = pace.measured or 0.0
    found = f"{measured:.1f} scans a second, {1e3 * age:.0f} ms old"
    slow = measured < SLOW * pace.nominal
    remedy = f"; it promises {pace.nominal}: check its line and power"
    return Check(name, not slow, found + remedy * slow)


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
        warm_up(Recognizer.load(model))
    seconds = f"{time.monotonic() - started:.1f} s"
    if compiled.buffer:
        return f"recognises; compiled now in {seconds}, kept on disk"
    return f"recognises; compiled code was ready, loaded in {seconds}"
