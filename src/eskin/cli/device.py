"""`eskin device`: virtual patches on real transports."""

import ipaddress
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import tyro

from eskin.cli.checks import check_writable
from eskin.errors import DeviceError, SkinMismatchError

if TYPE_CHECKING:
    from eskin.drivers.virtual import VirtualPort, VirtualSkin
    from eskin.skin import Skin
    from eskin.touch import Calibration, Scan

SIM = "sim"


@dataclass(frozen=True)
class Command:
    """Be a skin: its patches send what a person, or a recording, makes them feel."""

    skin: tyro.conf.Positional[str]
    """A skin that comes with eskin, or a folder with skin.yaml."""

    pty: bool = False
    """Send over pseudo-terminals, which are serial ports to whoever opens them; so it
    is unless --udp is given."""

    udp: str | None = None
    """Send datagrams to this HOST:PORT."""

    play: str = SIM
    """`sim` for a simulated person, or a recording of this skin, once."""

    fault: tyro.conf.UseAppendAction[tuple[str, ...]] = ()
    """What goes wrong: KIND[:WHERE][@FROM[-TO]][=AMOUNT], such as lose=0.1 or
    unplug:forearm_front@5-8; may be given several times."""

    rate: float | None = None
    """Scans a second; that of what is played unless given."""

    seconds: float | None = None
    """When to stop; at the end of the recording, or never, unless given."""

    ports: int = 1
    """Over how many ports, or sockets, the patches are spread."""

    link: Path | None = None
    """Stable name of the pseudo-terminal; with several ports, numbers follow it."""

    calibration: Path | None = None
    """Write what its electronics are here, for eskin run --calibration: each simulated
    build has its own, and a recording that of its skin."""

    seed: int = 0
    """Decides everything that is drawn."""


def run(command: Command) -> dict[str, object]:
    """Send until it is over or stopped, and return what was sent."""
    from eskin.drivers import HostClock
    from eskin.drivers.virtual import VirtualSkin, parse_fault, resample_scans
    from eskin.skin import load_skin
    from eskin.stream import stop_on_signals

    check(command)
    skin = load_skin(command.skin)
    faults = [
        parse_fault(text, skin, command.seed + number)
        for number, text in enumerate(command.fault)
    ]
    scans, own_rate, calibration = played(command, skin)
    rate = command.rate or own_rate
    with ExitStack() as stack:
        ports = opened(command, len(skin.patches), stack)
        device = VirtualSkin(skin, ports, rate, faults, command.seed)
        if command.calibration is not None:
            command.calibration.parent.mkdir(parents=True, exist_ok=True)
            command.calibration.write_bytes(calibration.to_bytes())
        introduce(device)
        if command.udp is not None and not is_loopback(
            parse_udp_address(command.udp)[0]
        ):
            print("what it feels leaves this computer, in the clear", flush=True)
        with stop_on_signals(device.stop):
            device.play(resample_scans(scans, rate), HostClock(), command.seconds)
    result = device.counters()
    print(
        f"{result['scans']} scans, {result['packets']} packets, {result['bytes']} bytes"
    )
    for fault in faults:
        print(f"  {fault.spec.text}: {fault.count} {fault.unit}")
    return result


def check(command: Command) -> None:
    """Refuse what cannot be meant, before the work is done.

    Raises:
        ValueError: an argument is out of range, or two do not go together.
    """
    if command.udp is not None and (command.pty or command.link is not None):
        raise ValueError(
            "--udp is given together with --pty or --link; allowed is one transport; "
            "leave out the other"
        )
    for name, value in (("rate", command.rate), ("seconds", command.seconds)):
        if value is not None and not 0 < value < float("inf"):
            raise ValueError(f"--{name} is {value}; allowed are above 0; change it")
    if command.seed < 0:
        raise ValueError(
            f"--seed is {command.seed}; allowed are 0 and above; change it"
        )
    if command.calibration is not None:
        check_writable(command.calibration)


def played(
    command: Command, skin: "Skin"
) -> "tuple[Iterator[Scan], float, Calibration]":
    """What the skin feels, how many scans a second that is, and its electronics.

    Raises:
        SkinMismatchError: the recording is of another skin.
        DeviceError: the recording is empty.
    """
    from eskin.recording import read_recording

    if command.play == SIM:
        from eskin.sim.dataset.clip_generator import Simulator
        from eskin.sim.interactive.player import TouchPlayer

        player = TouchPlayer(Simulator(command.skin), command.seed)
        print("somebody to touch it is made", flush=True)
        scans = player.scans()
        calibration = player.maker.calibration(player.build)
        return chain([next(scans)], scans), player.rate, calibration
    recording = read_recording(command.play)
    if recording.skin.patches != skin.patches or recording.skin.count != skin.count:
        raise SkinMismatchError(
            f"{command.play} is of skin '{recording.skin.name}', not of '{skin.name}'; "
            "allowed is a recording of the same skin; name its skin"
        )
    if recording.count < 2:
        raise DeviceError(
            f"{command.play} has {recording.count} scans; allowed are at least 2; "
            "play another"
        )
    return recording.scans(), 1e9 / recording.period, recording.calibration


def opened(command: Command, count: int, stack: ExitStack) -> "list[VirtualPort]":
    """The ports, which are closed with the stack.

    Raises:
        ValueError: there are more than patches, or the address is none.
    """
    from eskin.drivers.virtual import PtyPort, UdpPort

    if not 1 <= command.ports <= count:
        raise ValueError(
            f"--ports is {command.ports}; allowed are 1 to {count}, one for each patch"
        )
    if command.udp is not None:
        host, port = parse_udp_address(command.udp)
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


def parse_udp_address(text: str) -> tuple[str, int]:
    """Host and port of a HOST:PORT.

    Raises:
        ValueError: it is none.
    """
    host, port = None, None
    with suppress(ValueError):
        parts = urlsplit(f"//{text}")
        if not parts.path:
            host, port = parts.hostname, parts.port
    if not host or not port:
        raise ValueError(
            f"--udp is '{text}'; allowed is HOST:PORT with a port from 1 to 65535, "
            "such as 127.0.0.1:9750"
        )
    return host, port


def introduce(device: "VirtualSkin") -> None:
    """Print what to give to `eskin run`."""
    skin = device.skin
    print(
        f"skin '{skin.name}': {len(skin.patches)} patches, {skin.count} taxels, "
        f"{device.rate:g} scans a second"
    )
    for uri in dict.fromkeys(port.uri for port in device.ports):
        print(f"  --source {uri}")
    print("Ctrl-C ends it", flush=True)


def is_loopback(host: str) -> bool:
    """Whether a host is this computer, as far as its name tells."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
