"""This module opens sources and arms by their URIs, with all that they need."""

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
from jaxtyping import Float

from eskin.command.arm import Arm, ArmJoints
from eskin.drivers import (
    CalledJoints,
    Clock,
    CsvMatrix,
    DeviceSource,
    FixedJoints,
    HostClock,
    JointSource,
    SampleDevice,
    SampledSource,
    SerialTransport,
    Source,
    Transport,
    UdpJoints,
    UdpTransport,
    replay_source,
)
from eskin.drivers.joints import JointFunction
from eskin.errors import ArmError, DeviceError
from eskin.recording import Overrides, read_calibration
from eskin.recording.records import CALIBRATION_NAME
from eskin.registry import (
    ARMS,
    DRIVERS,
    ArmDriver,
    Driver,
    list_forms,
    load_plugin,
)
from eskin.robot import Robot
from eskin.skin import MountedSkin, Skin, load_robot_for_skin, mount_skin
from eskin.touch import Calibration

NOMINAL_CALIBRATION = "nominal_calibration.json"
"""Name of the calibration file of the preset skins, with the gain of every taxel."""

GRIPPER_OUTPUT = 0
"""Standard digital output of a UR that closes the gripper unless another is given."""

SERIAL_BAUD = 1_000_000
CSV_BAUD = 115_200
"""Baud rates of serial ports unless others are given, by the kind of source."""


@dataclass(frozen=True)
class SourceConfig:
    """A source configuration says how a source is opened; each kind uses a part."""

    skin: str | Path | Skin | None = None
    """Skin that devices are patches of: a preset's name, a folder, or a skin."""

    robot: str | Path | Robot | None = None
    """Robot that wears the skin: a preset's name, a URDF or a robot; None for the
    skin's own, or that of the recording that is played."""

    calibration: Path | Calibration | None = None
    """Calibration of its electronics; else that of the recording that is played, or
    `calibration.json` in the skin's folder, else the nominal calibration of the preset
    skins. A simulation has its own."""

    falling: bool = False
    """Whether counts fall under pressure, whatever the calibration says."""

    bits: int | None = None
    """Bits of the converter; None where the calibration's full scale is right."""

    q: tuple[float, ...] | None = None
    """Joint positions of a robot that does not move [rad]; all zero where None."""

    joints: JointSource | JointFunction | None = None
    """Source of joint positions in place of `q`, or a function that returns them [rad]
    at a stamp [ns since the epoch]."""

    rate: float | None = None
    """Scan rate of a device [1/s]; the rate that its patches announce where None."""

    pace: float = 1.0
    """Seconds of a recording or simulation played in a second; inf for all at once."""

    seed: int = 0
    """Seed of the simulated person."""

    baud: int | None = None
    """Baud rate of serial ports; None is 1,000,000, or 115,200 for `csv:`. Without
    meaning where the port is USB alone."""

    allow_remote: bool = False
    """Whether UDP packets from other computers are accepted: they do not tell their
    sender."""

    patience: float = 0.0
    """Longest wait for the first byte of a device [s]; 0 waits for none."""

    key: bytes | None = None
    """Key of the patches: packets without a valid seal are refused. None accepts
    packets that are not authenticated."""


def open_source(
    *uris: str,
    skin: str | Path | Skin | None = None,
    config: SourceConfig | None = None,
    clock: Clock | None = None,
) -> Source:
    """Open a source of scans.

    Args:
        uris: `serial:PATH` or `csv:PATH` (several for several ports),
            `udp://HOST:PORT`, `xela://HOST:PORT`, `replay:FILE` or `sim:SKIN`.
        skin: skin that devices are patches of, in place of that of `config`.
        config: how the source is opened.
        clock: clock that stamps scans; this computer's unless given.

    Raises:
        DeviceError: there is no such source, or it cannot be opened.
        EskinError: skin, robot, calibration or recording cannot be used.
    """
    config = config or SourceConfig()
    config = config if skin is None else replace(config, skin=skin)
    source = find_driver(uris).open(uris, config, clock or HostClock())
    calibration = source.info.calibration
    if config.falling:
        calibration = replace(calibration, falling=True)
    if config.bits is not None:
        calibration = set_bits(calibration, config.bits)
    source.info = replace(source.info, calibration=calibration)
    return source


def set_bits(calibration: Calibration, bits: int) -> Calibration:
    """Return a calibration for a converter of so many bits.

    Raises:
        DeviceError: it was measured with a converter of another full scale.
    """
    full_scale = 2**bits - 1
    if calibration.full_scale == full_scale:
        return calibration
    if calibration.source != "nominal":
        raise DeviceError(
            f"bits are {bits}, but the calibration was measured with a full scale of "
            f"{calibration.full_scale:,}; allowed are bits of a skin that is not "
            "calibrated; leave them out, or calibrate again with --calibration of the "
            "data sheet"
        )
    return calibration.with_full_scale(full_scale)


def find_driver(uris: Sequence[str]) -> Driver:
    """Return the driver of the kind of some URIs.

    Raises:
        DeviceError: there is none, they are several that are not one source, or one
            has no address.
    """
    kinds = {uri.partition(":")[0] for uri in uris}
    driver = load_plugin(DRIVERS, kinds.pop()) if len(kinds) == 1 else None
    if (
        driver is None
        or (len(uris) > 1 and not driver.takes_several)
        or (find_address(driver.form) and not all(map(find_address, uris)))
    ):
        raise DeviceError(
            f"source is '{' '.join(uris)}'; allowed is one of {list_forms(DRIVERS)}, "
            "or several serial ports"
        )
    return driver


def find_address(uri: str) -> str:
    """Return what follows the kind of a URI."""
    return uri.partition(":")[2].strip("/")


def open_recording(uris: Sequence[str], config: SourceConfig, clock: Clock) -> Source:
    """Open a recording as a source that plays it."""
    calibration = config.calibration
    if isinstance(calibration, Path):
        calibration = read_calibration(calibration)
    overrides = Overrides(calibration, load_robot_for_skin(None, config.robot))
    path = uris[0].partition(":")[2]
    return replay_source(path, config.pace, clock, True, overrides)


def open_arm(
    uri: str,
    clock: Clock | None = None,
    gripper_output: int = GRIPPER_OUTPUT,
    question_output: int | None = None,
) -> Arm:
    """Open an arm that works on its task.

    A simulated one begins at once; a real one is held until it is released.

    Args:
        uri: `sim:ur5` or `ur://HOST`.
        clock: the clock that it goes by; this computer's unless given.
        gripper_output: standard digital output of a UR that closes the gripper.
        question_output: standard digital output of a UR that is on while a question is
            open; None for none.

    Raises:
        ArmError: there is no such arm or output, it cannot be reached, or its driver is
            missing.
    """
    driver = find_arm_driver(uri)
    if question_output is not None:
        check_question_output(uri, gripper_output, question_output)
    outputs: list[int | None] = [gripper_output]
    if driver.outputs:
        outputs.append(question_output)
    return driver.open(uri, clock, *outputs)


def check_question_output(uri: str, gripper_output: int, question_output: int) -> None:
    """Raise if an arm cannot show a question by a digital output.

    Args:
        uri: URI of the arm.
        gripper_output: number of the output that closes the gripper.
        question_output: number of the output that is to show a question.

    Raises:
        ArmError: the arm has no such output, or its gripper has it.
    """
    count = find_arm_driver(uri).outputs
    if not 0 <= question_output < count or question_output == gripper_output:
        allowed = f"0 to {count - 1} except {gripper_output}, the gripper's"
        raise ArmError(
            f"output {question_output} of {uri} is to show a question; allowed are "
            f"{allowed if count else 'none, since it has no outputs'}; give another "
            "output, or ask in another way"
        )


def find_arm_driver(uri: str) -> ArmDriver:
    """Return the driver of the kind of an arm's URI.

    Raises:
        ArmError: there is none.
    """
    driver = load_plugin(ARMS, uri.partition(":")[0])
    if driver is None:
        raise ArmError(f"robot is '{uri}'; allowed is {list_forms(ARMS)}")
    return driver


def open_joints(
    uri: str, robot: Robot, clock: Clock | None = None, allow_remote: bool = False
) -> UdpJoints:
    """Open a source of joint positions, and wait for the first ones.

    Args:
        uri: `udp://HOST:PORT`, to which JSON is sent as `UdpJoints` describes.
        robot: robot whose joints they are.
        clock: clock that stamps them; this computer's unless given.
        allow_remote: whether datagrams of other computers are accepted.

    Raises:
        DeviceError: there is no such port, or nothing came within 3 s.
    """
    if not uri.startswith("udp:"):
        raise DeviceError(
            f"joints are '{uri}'; allowed is udp://HOST:PORT, such as "
            "udp://127.0.0.1:9760"
        )
    if not robot.joint_names:
        raise DeviceError(
            f"joints are '{uri}', but robot '{robot.name}' has no moving joint; "
            "allowed is a robot with joints; leave them out"
        )
    joints = UdpJoints(robot, *parse_udp_address(uri), clock, allow_remote)
    try:
        joints.wait()
    except DeviceError:
        joints.close()
        raise
    return joints


def open_device(uris: Sequence[str], config: SourceConfig, clock: Clock) -> Source:
    """Open patches on a cable or a network."""
    mounted = mount_device_skin(uris, config)
    calibration = load_calibration(config, mounted.skin)
    joints = choose_joints(config, mounted)
    with ExitStack() as stack:
        transport = open_transport(uris, config, clock)
        stack.callback(transport.close)
        source = DeviceSource(
            transport,
            mounted,
            calibration,
            joints,
            clock,
            " ".join(uris),
            config.rate,
            key=config.key,
            patience=config.patience,
        )
        stack.pop_all()
    return source


def mount_device_skin(uris: Sequence[str], config: SourceConfig) -> MountedSkin:
    """Load the skin that devices are patches of, on its robot.

    Raises:
        DeviceError: no skin is given.
    """
    if config.skin is None:
        raise DeviceError(
            f"source {uris[0]} is given without a skin; allowed is a preset's name or "
            "a skin's folder; say whose patches they are (--skin)"
        )
    return mount_skin(config.skin, config.robot)


def open_samples(
    uris: Sequence[str],
    config: SourceConfig,
    clock: Clock,
    build_device: Callable[[Skin], SampleDevice],
) -> Source:
    """Open a device that has a driver of its own.

    Args:
        uris: what the source is opened with.
        config: how it is opened.
        clock: clock that stamps its samples.
        build_device: function that returns the device of a skin.
    """
    mounted = mount_device_skin(uris, config)
    calibration = load_calibration(config, mounted.skin)
    joints = choose_joints(config, mounted)
    device = build_device(mounted.skin)
    with ExitStack() as stack:
        stack.callback(device.close)
        source = SampledSource(
            device,
            mounted,
            calibration,
            joints,
            clock,
            " ".join(uris),
            config.rate,
            config.patience,
        )
        stack.pop_all()
    return source


def open_csv(uris: Sequence[str], config: SourceConfig, clock: Clock) -> Source:
    """Open matrices that send lines of numbers."""
    paths = [uri.removeprefix("csv:") for uri in uris]
    baud = config.baud or CSV_BAUD
    return open_samples(
        uris, config, clock, lambda skin: CsvMatrix(clock, paths, skin, baud)
    )


def open_xela(uris: Sequence[str], config: SourceConfig, clock: Clock) -> Source:
    """Open the shear modules of a server."""
    from eskin.drivers.shear_modules import ShearModules

    address = f"ws:{uris[0].partition(':')[2]}"
    return open_samples(
        uris, config, clock, lambda skin: ShearModules(clock, address, skin)
    )


def open_transport(
    uris: Sequence[str], config: SourceConfig, clock: Clock
) -> Transport:
    """Open serial ports, or a UDP socket."""
    if uris[0].startswith("serial:"):
        paths = [uri.removeprefix("serial:") for uri in uris]
        return SerialTransport(clock, paths, config.baud or SERIAL_BAUD)
    host, port = parse_udp_address(uris[0])
    has_key = config.key is not None
    return UdpTransport(clock, host, port, config.allow_remote, has_key)


def parse_udp_address(uri: str) -> tuple[str, int]:
    """Return host and port of `udp://HOST:PORT`.

    Raises:
        DeviceError: the address has another form.
    """
    try:
        parts = urlsplit(uri)
        host = parts.hostname
        port = parts.port
        rest = parts.path
    except ValueError:
        host = None
        port = None
        rest = ""
    if not host or not port or rest:
        raise DeviceError(
            f"address is '{uri}'; allowed is udp://HOST:PORT with a port from 1 to "
            "65535, such as udp://127.0.0.1:9750"
        )
    return host, port


def choose_joints(config: SourceConfig, mounted: MountedSkin) -> JointSource:
    """Return the source of joint positions that a configuration asks for.

    Raises:
        DeviceError: there is not one position for each joint.
        ArmError: the joints of an arm are not found in the robot.
    """
    joints = config.joints or FixedJoints(fixed_positions(config, mounted))
    if isinstance(joints, Arm):
        return ArmJoints(joints, mounted.robot)
    if isinstance(joints, JointSource):
        return joints
    return CalledJoints(joints, mounted.robot)


def fixed_positions(
    config: SourceConfig, mounted: MountedSkin
) -> Float[np.ndarray, "joint"]:
    """Return the joint positions of a robot that does not move [rad]."""
    count = len(mounted.robot.joint_names)
    q = np.zeros(count) if config.q is None else np.array(config.q, np.float64)
    if len(q) != count or not np.isfinite(q).all():
        raise DeviceError(
            f"q is {config.q}; allowed are {count} finite numbers [rad], one for each "
            f"joint of robot '{mounted.robot.name}'"
        )
    return q


def load_calibration(config: SourceConfig, skin: Skin) -> Calibration:
    """Load the calibration that was given, or lies beside the skin, or is nominal.

    Raises:
        RecordingError: the file is no calibration.
        DeviceError: the file cannot be read.
    """
    if isinstance(config.calibration, Calibration):
        return config.calibration
    path = config.calibration
    if path is None and not isinstance(config.skin, Skin):
        folder = Path(config.skin or "")
        found = (folder if folder.is_dir() else folder.parent) / CALIBRATION_NAME
        path = found if folder.exists() and found.is_file() else None
    if path is None:
        return nominal_calibration(skin)
    return read_calibration(Path(path))


def nominal_calibration(skin: Skin) -> Calibration:
    """Load the nominal calibration of the preset skins, for the taxels of a skin."""
    data = (resources.files("eskin.skin") / NOMINAL_CALIBRATION).read_bytes()
    calibration = Calibration.from_bytes(data)
    return replace(calibration, gain=np.full(skin.count, calibration.gain[0]))


SERIAL = Driver(open_device, "serial:PATH", "cable", takes_several=True, takes_key=True)
UDP = Driver(open_device, "udp://HOST:PORT", takes_key=True)
CSV = Driver(open_csv, "csv:PATH", "cable", takes_several=True)
XELA = Driver(open_xela, "xela://HOST:PORT")
REPLAY = Driver(open_recording, "replay:FILE", "recorded")
"""Drivers that come with eskin, as its entry points name them."""
