"""This module holds what commands share that guide a person in the terminal."""

from contextlib import ExitStack
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from eskin.errors import DeviceError

if TYPE_CHECKING:
    from eskin.drivers import Source

PATIENCE = 10.0
"""Longest wait for the first byte of a device [s]."""
GUIDED_KINDS = {"serial", "csv", "udp", "xela", "replay"}
"""Schemes of the sources that a person can be guided with."""


@dataclass(frozen=True, kw_only=True)
class GuidedCommand:
    """The options that say which skin is read, and how."""

    source: tyro.conf.Positional[tuple[str, ...]]
    """Device, serial:PATH or csv:PATH (one or several), udp://HOST:PORT or
    xela://HOST:PORT; or replay:FILE."""

    skin: str | None = None
    """Skin of the device: a preset's name or a skin's folder. A recording has its own.
    """

    robot_urdf: str | None = None
    """Robot that the skin is mounted on: a URDF file or a preset's name. Preset skins
    have their own."""

    calibration: Path | None = None
    """Calibration file to start from; by default that of the recording, or
    calibration.json in the skin's folder, else a nominal one."""

    q: Annotated[tuple[float, ...] | None, tyro.conf.arg(metavar="RAD...")] = None
    """Joint positions [rad] of a robot that does not move; zeros by default."""

    joints: str | None = None
    """Address to which the joint positions of a robot are sent as JSON,
    udp://HOST:PORT."""

    rate: float | None = None
    """Rate of the device's scans [1/s]; by default the one that it announces."""

    baud: int | None = None
    """Baud rate of serial ports; ignored by ports that are USB only."""

    allow_remote: bool = False
    """Accept UDP packets from other computers without --key."""

    key: Path | None = None
    """Key file of the patches; packets without a valid seal are refused."""


def open_guided_source(
    command: GuidedCommand, pace: float, stack: ExitStack
) -> "Source":
    """Open a device, or a recording.

    Args:
        command: what is opened.
        pace: seconds of a recording that are played in a second.
        stack: what closes it.

    Raises:
        DeviceError: the source is neither.
    """
    from eskin.app import SourceConfig, open_joints, open_source
    from eskin.drivers import read_key
    from eskin.live import mount_skin

    check_joints(command.joints, command.q, command.source)

    kinds = {uri.partition(":")[0] for uri in command.source}
    if not command.source or not kinds <= GUIDED_KINDS:
        raise DeviceError(
            f"source is '{' '.join(command.source)}'; allowed are serial:PATH, "
            "csv:PATH, udp://HOST:PORT, xela://HOST:PORT and replay:FILE; correct it"
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
        q=command.q,
        rate=command.rate,
        pace=pace,
        patience=PATIENCE,
        baud=command.baud,
        allow_remote=command.allow_remote,
        key=None if command.key is None else read_key(command.key),
    )
    if command.skin is not None and command.joints is not None:
        robot = mount_skin(command.skin, command.robot_urdf).robot
        joints = open_joints(command.joints, robot, None, command.allow_remote)
        config = replace(config, joints=stack.enter_context(joints))
    return stack.enter_context(open_source(*command.source, config=config))


def check_joints(
    joints: str | None, q: tuple[float, ...] | None, sources: tuple[str, ...]
) -> None:
    """Raise if joint positions are given twice, or to a source that has its own.

    Raises:
        DeviceError: for --joints or --q.
    """
    if joints is not None and q is not None:
        raise DeviceError(
            "--joints is given with --q; allowed is one of them; leave out --q of a "
            "robot that moves"
        )
    played = [uri for uri in sources if uri.startswith(("replay:", "sim:"))]
    if joints is not None and played:
        raise DeviceError(
            f"--joints is given with {played[0]}, which has joint positions of its "
            "own; allowed is --joints with a device; leave it out"
        )


def print_line(line: str) -> None:
    """Print a line at once, unless it is empty."""
    if line:
        print(line, flush=True)
