"""Wiring: sources and arms by their URIs, with all that they need."""

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from jaxtyping import Float

from eskin.command import FRAME_TASK, Arm, MotionConfig, SimulatedArm, Task
from eskin.drivers import Clock, HostClock, Source, SourceInfo
from eskin.drivers.device_source import DeviceSource
from eskin.drivers.played_source import PlayedSource, replay_source
from eskin.drivers.serial_transport import SerialTransport
from eskin.drivers.source import FixedJoints, JointSource
from eskin.drivers.transport import Transport
from eskin.drivers.udp_transport import UdpTransport
from eskin.errors import ArmError, DeviceError, RecordingError
from eskin.live.recognizer import mount
from eskin.robot import Robot
from eskin.skin import MountedSkin, Skin
from eskin.touch import Calibration

CALIBRATION = "calibration.json"
"""Beside the `skin.yaml` of a skin: what its electronics are."""

ALLOWED = "serial:PATH, udp://HOST:PORT, replay:FILE or sim:SKIN"


@dataclass(frozen=True)
class SourceConfig:
    """How a source is opened; each kind takes of it what it needs."""

    skin: str | Path | Skin | None = None
    """The skin that devices are patches of: a preset's name, a folder, or a skin."""

    robot: str | Path | Robot | None = None
    """The robot that it is on: a preset's name or a URDF; a preset skin has its own."""

    calibration: Path | Calibration | None = None
    """Of its electronics; else `calibration.json` in the skin's folder, else that of
    the nominal laminate of the simulator."""

    q: tuple[float, ...] | None = None
    """Where the joints of a robot that does not move are [rad]; all zero where None."""

    joints: JointSource | None = None
    """Who tells where the joints are, in place of `q`."""

    rate: float | None = None
    """Scans a second of a device [1/s]; what its patches promise where None."""

    pace: float = 1.0
    """Seconds of a recording or simulation played in a second; inf for all at once."""

    seed: int = 0
    """Of the simulated person."""

    baud: int = 1_000_000
    """Of serial ports; without meaning where the port is USB alone."""

    allow_remote: bool = False
    """Whether UDP may be heard from other computers: it does not tell who sends."""


def open_source(
    *uris: str,
    skin: str | Path | Skin | None = None,
    config: SourceConfig | None = None,
    clock: Clock | None = None,
) -> Source:
    """Open a source of scans.

    Args:
        uris: `serial:PATH` (several for several ports), `udp://HOST:PORT`,
            `replay:FILE` or `sim:SKIN`.
        skin: that devices are patches of, in place of that of `config`.
        config: how it is opened.
        clock: that scans are stamped by; this computer's unless given.

    Raises:
        DeviceError: there is no such source, or it cannot be opened.
        EskinError: skin, robot, calibration or recording cannot be used.
    """
    config = config or SourceConfig()
    config = config if skin is None else replace(config, skin=skin)
    clock = clock or HostClock()
    kinds = {uri.partition(":")[0] for uri in uris}
    if kinds == {"serial"}:
        return device(uris, config, clock)
    if len(uris) != 1 or not kinds <= {"udp", "replay", "sim"}:
        raise DeviceError(
            f"source is '{' '.join(uris)}'; allowed is one of {ALLOWED}, or several "
            "serial ports; correct it"
        )
    if kinds == {"udp"}:
        return device(uris, config, clock)
    rest = uris[0].partition(":")[2]
    if kinds == {"replay"}:
        return replay_source(rest, config.pace, clock, restamp=True)
    return simulated(rest, config, clock)


def open_arm(
    uri: str,
    task: Task = FRAME_TASK,
    clock: Clock | None = None,
    motion: MotionConfig | None = None,
    gripper_output: int = 0,
) -> Arm:
    """Open an arm that goes about a task.

    A simulated one begins at once; a real one is held until it is released.

    Args:
        uri: `sim:ur5` or `ur://HOST`.
        task: what it does.
        clock: it goes by; this computer's unless given.
        motion: how fast it goes.
        gripper_output: standard digital output of a UR that closes the gripper.

    Raises:
        ArmError: there is no such arm, it cannot be reached, or its driver is missing.
    """
    kind, _, rest = uri.partition(":")
    host = rest.removeprefix("//")
    if kind == "sim" and rest == task.robot_name:
        return SimulatedArm(task, clock, motion)
    if kind != "ur" or not rest.startswith("//") or not host or "/" in host:
        raise ArmError(
            f"robot is '{uri}'; allowed is sim:{task.robot_name} or ur://HOST, such as "
            "ur://192.168.1.10; correct it"
        )
    if find_spec("rtde_control") is None:
        raise ArmError(
            f"robot is '{uri}', but ur_rtde is missing; allowed is with it installed; "
            "pip install 'eskin[ur]'"
        )
    from eskin.command.ur_arm import UrArm
    from eskin.ur import UrLink

    return UrArm(UrLink(host, gripper_output), task, clock, motion)


def device(uris: Sequence[str], config: SourceConfig, clock: Clock) -> Source:
    """Patches on a cable."""
    if config.skin is None:
        raise DeviceError(
            f"source {uris[0]} is given without a skin; allowed is a preset's name or "
            "a skin's folder; say whose patches they are"
        )
    mounted = mount(config.skin, config.robot)
    calibration = load_calibration(config, mounted.skin)
    joints = config.joints or FixedJoints(fixed_positions(config, mounted))
    with ExitStack() as stack:
        transport = open_transport(uris, config, clock)
        stack.callback(transport.close)
        source = DeviceSource(
            transport, mounted, calibration, joints, clock, " ".join(uris), config.rate
        )
        stack.pop_all()
    return source


def open_transport(
    uris: Sequence[str], config: SourceConfig, clock: Clock
) -> Transport:
    """Serial ports, or a UDP socket."""
    if uris[0].startswith("serial:"):
        paths = [uri.removeprefix("serial:") for uri in uris]
        return SerialTransport(clock, paths, config.baud)
    host, port = parse_udp_address(uris[0])
    return UdpTransport(clock, host, port, config.allow_remote)


def parse_udp_address(uri: str) -> tuple[str, int]:
    """Host and port of `udp://HOST:PORT`.

    Raises:
        DeviceError: it is none.
    """
    try:
        parts = urlsplit(uri)
        host, port, rest = parts.hostname, parts.port, parts.path
    except ValueError:
        host, port, rest = None, None, ""
    if not host or not port or rest:
        raise DeviceError(
            f"source is '{uri}'; allowed is udp://HOST:PORT with a port from 1 to "
            "65535, such as udp://127.0.0.1:9750; correct it"
        )
    return host, port


def fixed_positions(
    config: SourceConfig, mounted: MountedSkin
) -> Float[np.ndarray, "joint"]:
    """Joint positions of a robot that does not move [rad]."""
    count = len(mounted.robot.joint_names)
    q = np.zeros(count) if config.q is None else np.array(config.q, np.float64)
    if len(q) != count or not np.isfinite(q).all():
        raise DeviceError(
            f"q is {config.q}; allowed are {count} finite numbers [rad], one for each "
            f"joint of robot '{mounted.robot.name}'; correct it"
        )
    return q


def load_calibration(config: SourceConfig, skin: Skin) -> Calibration:
    """The calibration that was given, or lies beside the skin, or is nominal.

    Raises:
        RecordingError: the file is no calibration.
        DeviceError: it cannot be read.
    """
    if isinstance(config.calibration, Calibration):
        return config.calibration
    path = config.calibration
    if path is None and not isinstance(config.skin, Skin):
        folder = Path(config.skin or "")
        beside = (folder if folder.is_dir() else folder.parent) / CALIBRATION
        path = beside if folder.exists() and beside.is_file() else None
    if path is None:
        return nominal_calibration(skin)
    try:
        return Calibration.from_bytes(Path(path).read_bytes())
    except RecordingError as error:
        raise RecordingError(f"{path}: {error}") from error
    except OSError as error:
        raise DeviceError(
            f"calibration {path} cannot be read ({error.strerror}); allowed is a JSON "
            "file as Calibration.to_bytes writes it; correct the path"
        ) from error


def nominal_calibration(skin: Skin) -> Calibration:
    """Of the laminate and electronics that the simulator takes for usual."""
    from eskin.sim.constants import load_constants
    from eskin.sim.sensor.build import nominal_build

    return nominal_build(skin, load_constants()).calibration(skin)


def simulated(skin: str, config: SourceConfig, clock: Clock) -> Source:
    """A person who was in no training set, touching a skin without end."""
    from eskin.sim.dataset.clip_generator import Simulator
    from eskin.sim.interactive.player import Player

    player = Player(Simulator(skin), config.seed)
    maker = player.maker
    info = SourceInfo(
        uri=f"sim:{skin}",
        robot_name=maker.robot_name,
        joint_names=maker.mounted.robot.joint_names,
        skin=maker.mounted.skin,
        calibration=maker.calibration(player.build),
        rate=player.rate,
    )
    return PlayedSource(info, player.scans(), config.pace, clock, restamp=True)
