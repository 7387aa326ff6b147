"""`eskin device` simulates patches on real transports."""

import ipaddress
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from eskin.cli.checks import NOT_NEGATIVE, POSITIVE, Excludes, check_writable
from eskin.errors import DeviceError, SkinMismatchError
from eskin.sim.commands.untouched import print_untouched
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.sim.virtual import VirtualPort, VirtualSkin
    from eskin.skin import Skin
    from eskin.touch import Calibration, Scan

SIM = "sim"


@dataclass(frozen=True)
class DeviceCommand:
    """Act as a skin: its patches send the touches of a simulated person or a recording.

    Each patch sends its scans over a real transport, as the hardware does.
    """

    skin: tyro.conf.Positional[str]
    """Name of a skin that comes with eskin, or a folder with skin.yaml."""

    robot_urdf: str | None = None
    """Robot that wears the skin, for a simulated person: a URDF file or a preset's
    name; by default the skin's own."""

    pty: bool = False
    """Send over pseudo-terminals, which act as serial ports. This is the default unless
    --udp is given."""

    udp: Annotated[str | None, Excludes("pty"), Excludes("link")] = None
    """Send datagrams to this HOST:PORT."""

    play: str = SIM
    """`sim` for a simulated person, or the path of a recording of this skin, which is
    played once."""

    fault: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """Fault to inject: KIND[:WHERE][@FROM[-TO]][=AMOUNT], such as lose=0.1 or
    unplug:forearm_front@5-8. The option may be given several times."""

    rate: Annotated[float | None, POSITIVE] = None
    """Rate of the scans [1/s]; by default the rate of the recording or simulation."""

    seconds: Annotated[float | None, POSITIVE] = None
    """Time after which to stop [s]; by default the end of the recording, or never."""

    ports: int = 1
    """Number of ports, or sockets, over which the patches are spread."""

    link: Path | None = None
    """Stable path of the pseudo-terminal. With several ports, a number follows it."""

    calibration: Path | None = None
    """Path of a calibration file to write, for eskin run --calibration. Each simulated
    build has its own calibration, and a recording that of its skin."""

    seed: Annotated[int, NOT_NEGATIVE] = 0
    """Random seed."""

    protocol: Literal[1, 2] = 2
    """Version of the device protocol: patches of version 2 also answer the host's
    requests."""

    key: Path | None = None
    """Key file with which packets are sealed, for eskin run --key."""


def run(command: DeviceCommand) -> dict[str, object]:
    """Send until the end or until stopped; return the counts of what was sent."""
    from eskin.drivers import HostClock, read_key
    from eskin.recording import write_calibration
    from eskin.sim.virtual import VirtualSkin, parse_fault, resample_scans
    from eskin.skin import load_skin
    from eskin.stream import stop_on_signals

    if command.key is not None and command.protocol == 1:
        raise ValueError(
            "--key is given with --protocol 1, which has no seals; allowed is a key "
            "with version 2; leave out --protocol"
        )
    if command.calibration is not None:
        check_writable(command.calibration)
    key = None if command.key is None else read_key(command.key)
    skin = load_skin(command.skin)
    faults = [
        parse_fault(text, skin, command.seed + number)
        for number, text in enumerate(command.fault)
    ]
    scans, own_rate, calibration = load_played(command, skin)
    rate = command.rate or own_rate
    with ExitStack() as stack:
        ports = open_ports(command, len(skin.patches), stack)
        device = VirtualSkin(
            skin, ports, rate, faults, command.seed, command.protocol, key
        )
        if command.calibration is not None:
            write_calibration(command.calibration, calibration)
        print_addresses(device)
        if command.udp is not None and not is_loopback(parse_target(command.udp)[0]):
            print("what the skin senses leaves this computer unencrypted", flush=True)
        with stop_on_signals(device.stop):
            device.play(resample_scans(scans, rate), HostClock(), command.seconds)
    result = device.counters()
    print(
        f"{format_count(result['scans'], 'scan')}, "
        f"{format_count(result['packets'], 'packet')}, "
        f"{format_count(result['bytes'], 'byte')}"
    )
    for fault in faults:
        print(f"  {fault.spec.text}: {fault.count} {fault.unit}")
    return result


def load_played(
    command: DeviceCommand, skin: "Skin"
) -> "tuple[Iterator[Scan], float, Calibration]":
    """Load the scans to play, their rate [1/s] and the calibration.

    Raises:
        SkinMismatchError: when the recording is of another skin.
        DeviceError: when the recording is empty.
    """
    from eskin.recording import read_recording

    if command.play == SIM:
        from eskin.sim.dataset import Simulator
        from eskin.sim.interactive import TouchPlayer

        print_untouched(command.skin, command.robot_urdf)
        simulator = Simulator(command.skin, robot=command.robot_urdf)
        player = TouchPlayer(simulator, command.seed)
        print("a person who touches the skin is simulated", flush=True)
        scans = player.scans()
        calibration = player.generator.calibration(player.build)
        return chain([next(scans)], scans), player.rate, calibration
    recording = read_recording(command.play)
    if recording.skin.patches != skin.patches or recording.skin.count != skin.count:
        raise SkinMismatchError(
            f"{command.play} is of skin '{recording.skin.name}', not of '{skin.name}'; "
            "allowed is a recording of the same skin; name its skin"
        )
    if recording.count < 2:
        raise DeviceError(
            f"{command.play} has {format_count(recording.count, 'scan')}; allowed are "
            "2 or more"
        )
    return recording.scans(), 1e9 / recording.period, recording.calibration


def open_ports(
    command: DeviceCommand, count: int, stack: ExitStack
) -> "list[VirtualPort]":
    """Open the ports; the stack closes them.

    Raises:
        ValueError: when there are more ports than patches, or the address is invalid.
    """
    from eskin.sim.virtual import PtyPort, UdpPort

    if not 1 <= command.ports <= count:
        raise ValueError(
            f"--ports is {command.ports}; allowed are 1 to {count}, one for each patch"
        )
    if command.udp is not None:
        host, port = parse_target(command.udp)
        return [stack.enter_context(UdpPort(host, port)) for _ in range(command.ports)]
    link = command.link
    if link is None:
        folder = stack.enter_context(tempfile.TemporaryDirectory(prefix="eskin-"))
        link = Path(folder) / "port"
    names = [
        link.with_name(f"{link.name}{number}") if command.ports > 1 else link
        for number in range(command.ports)
    ]
    return [stack.enter_context(PtyPort(name)) for name in names]


def parse_target(text: str) -> tuple[str, int]:
    """Parse HOST:PORT.

    Raises:
        DeviceError: when the text is not of this form.
    """
    from eskin.app import parse_udp_address

    return parse_udp_address(f"udp://{text}")


def print_addresses(device: "VirtualSkin") -> None:
    """Print the skin and the --source options for `eskin run`."""
    skin = device.skin
    print(
        f"skin '{skin.name}': {format_count(len(skin.patches), 'patch')}, "
        f"{format_count(skin.count, 'taxel')}, {device.rate:g} scans a second"
    )
    for uri in dict.fromkeys(port.uri for port in device.ports):
        print(f"  --source {uri}")
    print("Ctrl-C ends it", flush=True)


def is_loopback(host: str) -> bool:
    """Tell whether a host's name or address is this computer's."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
