"""This module holds what commands share that guide a person in the terminal."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import tyro

from eskin.errors import DeviceError

if TYPE_CHECKING:
    from eskin.drivers import Source


@dataclass(frozen=True, kw_only=True)
class GuidedCommand:
    """The options that say which skin is read, and how."""

    source: tyro.conf.Positional[tuple[str, ...]]
    """Device, serial:PATH (one or several) or udp://HOST:PORT; or replay:FILE."""

    skin: str | None = None
    """Skin of the device: a preset's name or a skin's folder. A recording has its own.
    """

    robot_urdf: str | None = None
    """Robot that the skin is mounted on: a URDF file or a preset's name. Preset skins
    have their own."""

    calibration: Path | None = None
    """Calibration file to start from; by default that of the recording, or
    calibration.json in the skin's folder, else a nominal one."""

    rate: float | None = None
    """Rate of the device's scans [1/s]; by default the one that it announces."""

    baud: int | None = None
    """Baud rate of serial ports; ignored by ports that are USB only."""

    allow_remote: bool = False
    """Accept UDP packets from other computers without --key."""

    key: Path | None = None
    """Key file of the patches; packets without a valid seal are refused."""


def open_guided_source(command: GuidedCommand, pace: float) -> "Source":
    """Open a device, or a recording.

    Args:
        command: what is opened.
        pace: seconds of a recording that are played in a second.

    Raises:
        DeviceError: the source is neither.
    """
    from eskin.app import SourceConfig, open_source
    from eskin.drivers import read_key

    kinds = {uri.partition(":")[0] for uri in command.source}
    if not command.source or not kinds <= {"serial", "udp", "replay"}:
        raise DeviceError(
            f"source is '{' '.join(command.source)}'; allowed are serial:PATH, "
            "udp://HOST:PORT and replay:FILE; correct it"
        )
    if command.skin is None and "replay" not in kinds:
        raise DeviceError(
            f"{command.source[0]} is given without --skin; allowed is a preset's name "
            "or a skin's folder; say whose patches they are"
        )
    config = SourceConfig(
        skin=command.skin,
        robot=command.robot_urdf,
        calibration=command.calibration,
        rate=command.rate,
        pace=pace,
        baud=command.baud,
        allow_remote=command.allow_remote,
        key=None if command.key is None else read_key(command.key),
    )
    return open_source(*command.source, config=config)


def print_line(line: str) -> None:
    """Print a line at once, unless it is empty."""
    if line:
        print(line, flush=True)
