"""`eskin run`: the live system."""

import gc
import math
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from eskin.errors import ArmError, DeviceError

if TYPE_CHECKING:
    from eskin.command import Arm, Policy
    from eskin.drivers import Clock, Source
    from eskin.model import Model
    from eskin.stream import Listener, Recognition, Stream
    from eskin.stream.listener import Drop


PORT = 8080
"""Of the page, unless another is given."""


@dataclass(frozen=True)
class Command:
    """Recognise live: from patches on a cable, a recording or a simulated person.

    Ends with its source, after --seconds, or by Ctrl-C, which finishes the recording.
    """

    source: tuple[str, ...]
    """serial:PATH, of several ports too, udp://HOST:PORT, replay:FILE or sim:SKIN."""

    skin: str | None = None
    """Whose patches they are: a preset's name or a skin's folder; a recording and a
    simulation know their own."""

    model: str = "ur5"
    """Weights that come with eskin, or a model file."""

    robot_urdf: str | None = None
    """The robot that the skin is on, a URDF file or a preset's name; a preset skin has
    its own."""

    calibration: Path | None = None
    """Of the electronics, as eskin device --calibration writes it; else
    calibration.json in the skin's folder, else nominal."""

    q: Annotated[tuple[float, ...] | None, tyro.conf.arg(metavar="RAD...")] = None
    """Where the joints are [rad], of a robot that does not move; zeros unless given."""

    robot: str | None = None
    """The arm that touches command: sim:ur5 or ur://HOST; it tells where the joints
    are. A real one is held until a poke pauses it and another resumes it."""

    commands: Path | None = None
    """Which touch commands what; the map that comes with eskin unless given."""

    record: Path | None = None
    """Record scans, detections and events here."""

    piece_mb: float | None = None
    """Begin a new file when the recording has grown to this size [MB]."""

    seconds: float | None = None
    """When to stop."""

    rate: float | None = None
    """Scans a second of devices; what they promise unless given."""

    pace: float = 1.0
    """Seconds of a recording or simulation played in a second; inf for as fast as it
    is recognised."""

    seed: int = 0
    """Of the simulated person."""

    baud: int = 1_000_000
    """Of serial ports; without meaning where the port is USB alone."""

    allow_remote: bool = False
    """Listen to other computers by UDP, which does not tell who sends."""

    view: bool = False
    """Show it in the browser; nothing can be touched or commanded there."""

    port: int | None = None
    """Of the page on this computer, 8080 unless given; 0 for any free one."""


def run(command: Command) -> dict[str, object]:
    """Stream until it is over; detections and events are printed as they come."""
    from eskin.app import SourceConfig, open_source
    from eskin.drivers import HostClock
    from eskin.live import Recognizer, mount_skin, warm_up
    from eskin.model import load_model
    from eskin.robot import load_recorded_robot
    from eskin.skin import MountedSkin
    from eskin.stream import (
        Recognition,
        Stream,
        short_switch_interval,
        stop_on_signals,
    )

    check(command)
    model, clock = load_model(command.model), HostClock()
    config = SourceConfig(
        skin=command.skin,
        robot=command.robot_urdf,
        calibration=command.calibration,
        q=command.q,
        rate=command.rate,
        pace=command.pace,
        seed=command.seed,
        baud=command.baud,
        allow_remote=command.allow_remote,
    )
    with ExitStack() as stack:
        # Devices send whether or not anybody is ready: what is compiled comes first.
        if command.skin is not None:
            warm_up(
                Recognizer(model, mount_skin(command.skin, command.robot_urdf), None)
            )
        arm = arm_of(command, clock)
        if arm is not None:
            config = replace(config, joints=stack.enter_context(arm))
        source = open_source(*command.source, config=config, clock=clock)
        stack.enter_context(source)
        info = source.info
        robot = load_recorded_robot(info.robot_name, command.robot_urdf)
        mounted = MountedSkin(info.skin, robot)
        recognizer = Recognizer(model, mounted, info.calibration)
        if command.skin is None:
            warm_up(recognizer)
        gc.freeze()
        recognition = Recognition(recognizer, drop=drop_of(command))
        policies = [] if arm is None else [policy_of(command, arm, model, source)]
        others = [*policies, *listeners_of(command, source, recognition, arm)]
        stream = Stream(source, [recognition, *others])
        introduce(source)
        with stop_on_signals(stream.stop), short_switch_interval(), stream:
            stream.wait(command.seconds)
    commands = sum(policy.accepted for policy in policies)
    return summary(source, stream, recognition, commands)


def drop_of(command: Command) -> "Drop":
    """What happens to scans that come faster than they are recognised.

    A recording that is read as fast as it goes waits; what is live does not.
    """
    return "never" if math.isinf(command.pace) else "oldest"


def check(command: Command) -> None:
    """Refuse what cannot be meant, before anything is opened.

    Raises:
        DeviceError: a number is out of range.
    """
    for name in ("seconds", "rate", "pace", "piece_mb"):
        value = getattr(command, name)
        if value is not None and not value > 0:
            option = name.replace("_", "-")
            raise DeviceError(f"--{option} is {value}; allowed are above 0; change it")
    if command.piece_mb == math.inf:
        raise DeviceError("--piece-mb is inf; allowed is a finite size; leave it out")
    if command.piece_mb is not None and command.record is None:
        raise DeviceError(
            "--piece-mb is given without --record; allowed is both; name the recording"
        )
    if command.port is not None and not command.view:
        raise DeviceError(
            "--port is given without --view; allowed is both; ask for the page"
        )
    if command.commands is not None and command.robot is None:
        raise ArmError(
            "--commands is given without --robot; allowed is both; say which robot"
        )
    if command.robot is not None and command.q is not None:
        raise ArmError(
            "--q is given with --robot; allowed is one of them; the robot tells where "
            "its joints are"
        )
    if (command.robot or "").startswith("ur:"):
        check_senders(command)


def check_senders(command: Command) -> None:
    """Refuse that other computers move a real robot, unless that is allowed.

    Raises:
        DeviceError: a source can be heard from other computers.
    """
    from eskin.app import parse_udp_address
    from eskin.drivers import check_udp_host

    for uri in command.source:
        if uri.startswith("udp:"):
            check_udp_host(parse_udp_address(uri)[0], command.allow_remote)


def arm_of(command: Command, clock: "Clock") -> "Arm | None":
    """The arm that is commanded, where one is."""
    from eskin.app import open_arm

    return None if command.robot is None else open_arm(command.robot, clock=clock)


def policy_of(
    command: Command, arm: "Arm", model: "Model", source: "Source"
) -> "Policy":
    """What commands the arm.

    Raises:
        CommandError: the command map cannot be used.
    """
    from eskin.command import Policy, load_commands

    vocabulary = model.card.vocabulary
    commands = load_commands(command.commands, vocabulary, source.info.skin)
    return Policy(arm, commands, vocabulary)


def listeners_of(
    command: Command, source: "Source", recognition: "Recognition", arm: "Arm | None"
) -> "list[Listener]":
    """Who else listens: the terminal; recorder and viewer where they are wanted."""
    from eskin.cli.terminal import Terminal
    from eskin.recording import Metadata
    from eskin.stream import Recorder, RecorderConfig

    listeners: list[Listener] = [Terminal()]
    if command.record is not None:
        piece = None if command.piece_mb is None else round(1e6 * command.piece_mb)
        metadata = Metadata("live", "unknown", source.info.uri)
        config = RecorderConfig(piece_bytes=piece)
        listeners.append(Recorder(command.record, metadata, config))
    if command.view:
        from eskin.page.port import free_port
        from eskin.viewer import Viewer, ViewerConfig

        port = free_port(PORT if command.port is None else command.port)
        listeners.append(Viewer(recognition, ViewerConfig(port), arm=arm))
        print(f"see http://127.0.0.1:{port}", flush=True)
    return listeners


def introduce(source: "Source") -> None:
    """Print what is listened to."""
    info = source.info
    print(
        f"{info.uri}: skin '{info.skin.name}', {info.skin.count} taxels on "
        f"'{info.robot_name}', {info.rate:g} scans a second; Ctrl-C ends it",
        flush=True,
    )


def summary(
    source: "Source", stream: "Stream", recognition: "Recognition", commands: int
) -> dict[str, object]:
    """Print and return what came and what was made of it."""
    counted, queues = source.counters(), stream.queue_counts()
    skipped = counted.get("skipped", 0)
    dropped = skipped + sum(queue.dropped for queue in queues.values())
    step = recognition.step
    print(
        f"{counted['readings']} readings, {dropped} dropped; a step took "
        f"{1e3 * step.quantile(0.5):.2f} ms (p99 {1e3 * step.quantile(0.99):.2f} ms)"
    )
    rest = {key: value for key, value in counted.items() if value}
    print("  " + ", ".join(f"{key} {value}" for key, value in rest.items()))
    return {
        "readings": counted["readings"],
        "dropped": dropped,
        "detections": recognition.detections,
        "commands": commands,
        "step_ms_p50": 1e3 * step.quantile(0.5),
        "step_ms_p99": 1e3 * step.quantile(0.99),
        "age_ms_p50": 1e3 * recognition.age.quantile(0.5),
        "age_ms_p99": 1e3 * recognition.age.quantile(0.99),
        "source": counted,
        "queues": {name: asdict(queue) for name, queue in queues.items()},
    }
