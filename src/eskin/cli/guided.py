"""This module holds what commands share that guide a person in the terminal."""

from pathlib import Path
from typing import TYPE_CHECKING, Protocol

from eskin.errors import DeviceError

if TYPE_CHECKING:
    from eskin.drivers import Source


class GuidedCommand(Protocol):
    """The options that say which skin is read, and how."""

    @property
    def source(self) -> tuple[str, ...]:
        """URIs of the source."""
        ...

    @property
    def skin(self) -> str | None:
        """Name or folder of the skin."""
        ...

    @property
    def robot_urdf(self) -> str | None:
        """Robot of the skin."""
        ...

    @property
    def calibration(self) -> Path | None:
        """Path of the calibration."""
        ...

    @property
    def rate(self) -> float | None:
        """Rate of the scans [1/s]."""
        ...

    @property
    def baud(self) -> int:
        """Baud rate of serial ports."""
        ...

    @property
    def allow_remote(self) -> bool:
        """Whether packets from other computers are accepted."""
        ...

    @property
    def key(self) -> Path | None:
        """Path of the key file."""
        ...


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
