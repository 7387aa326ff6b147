"""`eskin run` runs the live system."""

import gc
import math
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import partial
from importlib import import_module
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from eskin.cli.checks import (
    POSITIVE,
    POSITIVE_OR_INF,
    Excludes,
    Needs,
    is_given,
    name_option,
)
from eskin.cli.guided import PATIENCE, SourceCommand, check_source, say
from eskin.errors import ArmError, DeviceError
from eskin.units import format_count

if TYPE_CHECKING:
    from eskin.bus import Publisher
    from eskin.bus.ros2 import Ros2Joints, Ros2Node
    from eskin.command import Arm, Policy
    from eskin.drivers import Clock, JointSource, Source
    from eskin.drivers.joints import JointFunction
    from eskin.live import Model
    from eskin.registry import Driver
    from eskin.robot import Robot
    from eskin.stream import Listener, Recognition, Stream
    from eskin.stream.listener import Drop
    from eskin.touch import Calibration


WAYS = {"terminal": None, "page": "view", "ros2": "ros2", "foxglove": "foxglove"}
"""Ways of `--ask` beside an output, with the field of the option that each needs."""
OUTPUT = "output:"
"""How the way of a digital output begins; its number follows."""
CONFIDENCE = 1.96
"""Number of standard deviations of an interval of 95 % to either side."""


@dataclass(frozen=True)
class RunCommand(SourceCommand):
    """Recognise live: from patches on a cable, a recording or a simulated person.

    The command ends with its source, after --seconds, or by Ctrl-C, which finishes the
    recording.
    """

    source: tuple[str, ...]
    """Source of the scans: serial:PATH or csv:PATH (one or several), udp://HOST:PORT,
    xela://HOST:PORT, replay:FILE or sim:SKIN."""

    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""

    robot: Annotated[str | None, Excludes("q"), Excludes("joints")] = None
    """Arm that touches command: sim:ur5 or ur://HOST. It also gives the joint
    positions. A real arm is held until a touch pauses it and another resumes it: with
    the default map a poke, a second later a grab, and a poke when it asks."""

    ask: Annotated[tuple[str, ...], Needs("robot")] = ()
    """Where the arm shows its question before it resumes, moves on or speeds up, so
    that people at it can answer; at least one for a real arm: terminal, page (with
    --view), ros2, foxglove, or output:N, a digital output of a UR that is on while it
    asks."""

    commands: Annotated[Path | None, Needs("robot")] = None
    """Command map, which tells what each touch commands: a file, or `paper` for that of
    the paper on a simulated arm; by default the one that comes with eskin."""

    record: Path | None = None
    """Path of a recording of scans, detections and events."""

    piece_mb: Annotated[float | None, POSITIVE, Needs("record")] = None
    """Size of the recording from which a new file is started [MB]."""

    seconds: Annotated[float | None, POSITIVE_OR_INF] = None
    """Time after which to stop [s]."""

    pace: Annotated[float, POSITIVE_OR_INF] = 1.0
    """Speed of a recording or simulation relative to real time; inf is as fast as it is
    recognised. With --robot it is 1, as the arm moves in real time."""

    seed: int = 0
    """Random seed of the simulated person."""

    allow_unauthenticated: bool = False
    """Let a udp:// source without --key, or an xela:// source, command a real robot,
    although any program that can send to its port can fake touches."""

    allow_simulated_touch: bool = False
    """Let touches of a recording or a simulated person command a real robot."""

    view: bool = False
    """Show the skin in the browser; nothing can be touched or commanded there."""

    port: Annotated[int | None, Needs("view")] = None
    """TCP port of the page on this computer, 8080 by default; 0 takes any free one."""

    ros2: bool = False
    """Publish readings, contacts, detections, diagnostics and markers as topics of ROS
    2 in the domain ROS_DOMAIN_ID, and take joint positions from /joint_states where
    neither --robot nor --q nor the source has them."""

    ros2_reliable: Annotated[bool, Needs("ros2")] = False
    """Send readings, contacts and markers of --ros2 again when they are lost; for
    subscribers that ask for it."""

    foxglove: bool = False
    """Serve robot, taxels, contacts and detections to Foxglove on this computer."""

    foxglove_port: Annotated[int | None, Needs("foxglove")] = None
    """TCP port for Foxglove, 8765 by default; 0 takes any free one."""


def run(command: RunCommand) -> dict[str, object]:
    """Stream until the end; print detections and events as they come."""
    from eskin.app import open_joints, open_source
    from eskin.drivers import HostClock
    from eskin.live import Recognizer, load_model, warm_up
    from eskin.skin import mount_skin
    from eskin.stream import (
        Recognition,
        Stream,
        short_switch_interval,
        stop_on_signals,
    )

    check_options(command)
    import_buses(command)
    model = load_model(command.model)
    clock = HostClock()
    config = replace(
        command.build_config(command.pace),
        seed=command.seed,
        patience=min(PATIENCE, command.seconds or PATIENCE),
    )
    with ExitStack() as stack:
        # Devices send at any time, so code is compiled before they are opened.
        mounted = None
        if command.skin is not None:
            mounted = mount_skin(command.skin, command.robot_urdf)
            warm_up(Recognizer(model, mounted, None))
            if command.joints is not None:
                joints = open_joints(
                    command.joints, mounted.robot, clock, command.allow_remote
                )
                config = replace(config, joints=stack.enter_context(joints))
        arm = open_command_arm(command, clock)
        if arm is not None:
            config = replace(config, joints=stack.enter_context(arm))
        node = open_ros2_node(command)
        if node is not None:
            stack.enter_context(node)
            # Without a skin, the source will be refused.
            if mounted is not None and is_without_joints(command):
                joints = subscribe_joints(mounted.robot, node, clock)
                if joints is not None:
                    config = replace(config, joints=stack.enter_context(joints))
        source = open_source(*command.source, config=config, clock=clock)
        stack.enter_context(source)
        info = source.info
        recognizer = Recognizer(model, info.mounted, info.calibration)
        if command.skin is None:
            warm_up(recognizer)
        gc.freeze()
        recognition = Recognition(recognizer, drop=choose_drop_policy(command))
        policies = [] if arm is None else [build_policy(command, arm, model, source)]
        doubts = describe_doubts(command, info.calibration)
        listeners = build_listeners(command, source, recognition, arm, policies, doubts)
        publishers = build_publishers(command, recognition, node, config.joints)
        others = [*policies, *listeners, *publishers]
        stream = Stream(source, [recognition, *others])
        print_source(source, doubts)
        with stop_on_signals(stream.stop), short_switch_interval(), stream:
            stream.wait(command.seconds)
    commands = sum(policy.accepted for policy in policies)
    return summarise(source, stream, recognition, commands)


def choose_drop_policy(command: RunCommand) -> "Drop":
    """Choose which scans are dropped when they come faster than they are recognised.

    A recording that is read as fast as possible waits; a live source does not.
    """
    return "never" if math.isinf(command.pace) else "oldest"


def check_options(command: RunCommand) -> None:
    """Raise if options do not go with the source.

    Raises:
        DeviceError: for joint positions, a key, or a robot that is real.
        CommandError: for a command map that is not for a real robot.
        ArmError: for a way to ask that there is not, a real robot without one, or a
            robot with touches that are not in real time.
    """
    driver = check_source(command)
    if command.key is not None and not driver.takes_key:
        raise DeviceError(
            f"--key is given with {' '.join(command.source)}; allowed is a key with "
            "serial: or udp: sources, whose packets it checks; leave it out"
        )
    if command.robot is not None and command.pace != 1.0:
        raise ArmError(
            f"--pace is {command.pace:g} with --robot {command.robot}, which moves in "
            "real time; allowed is 1; leave --pace or --robot out"
        )
    if commands_real_robot(command):
        check_touches(command, driver)
        check_commands(command)
    check_ways(command)


def commands_real_robot(command: RunCommand) -> bool:
    """Return whether touches command a robot that a person can be near."""
    from eskin.app import find_arm_driver

    return command.robot is not None and find_arm_driver(command.robot).is_real


def check_commands(command: RunCommand) -> None:
    """Raise if the command map is not for a real robot.

    Raises:
        CommandError: it is for simulated arms alone, or cannot be read.
    """
    from eskin.command.command_map import check_real, read_commands

    check_real(read_commands(command.commands), command.commands)


def check_ways(command: RunCommand) -> None:
    """Raise if the arm cannot ask in the ways that are given, or a real one in none.

    Raises:
        ArmError: there is no such way or output, or the option is missing that it
            needs.
    """
    from eskin.app import GRIPPER_OUTPUT, check_question_output

    if command.robot is None:
        return
    if not command.ask and commands_real_robot(command):
        raise ArmError(
            f"--robot {command.robot} is real and cannot ask whether to start; allowed "
            f"is --ask with one or more of {describe_ways()}; give those that people "
            "at the robot see or hear"
        )
    outputs = find_outputs(command.ask)
    if len(outputs) > 1:
        raise ArmError(
            f"--ask names {len(outputs)} outputs; allowed is one; leave the others out"
        )
    for output in outputs.values():
        check_question_output(command.robot, GRIPPER_OUTPUT, output)
    for way in command.ask:
        if way not in WAYS and way not in outputs:
            raise ArmError(f"--ask is '{way}'; allowed are {describe_ways()}")
        needed = WAYS.get(way)
        if needed is not None and not is_given(getattr(command, needed)):
            raise ArmError(
                f"--ask {way} is given without {name_option(needed)}; allowed is both; "
                "add it, or ask in another way"
            )


def describe_ways() -> str:
    """Return the ways in which an arm can ask, with the options that they need."""
    named = [
        way if needed is None else f"{way} (with {name_option(needed)})"
        for way, needed in WAYS.items()
    ]
    return f"{', '.join(named)} or {OUTPUT}N (digital output N of a UR)"


def find_outputs(ways: tuple[str, ...]) -> dict[str, int]:
    """Return the ways to ask that name an output, with its number."""
    numbers = {way: way.removeprefix(OUTPUT) for way in ways if OUTPUT in way}
    return {way: int(text) for way, text in numbers.items() if text.isdecimal()}


def check_touches(command: RunCommand, driver: "Driver") -> None:
    """Raise if others than who touches the skin could move a real robot.

    Raises:
        DeviceError: when touches are simulated, or packets could be forged, and the
            option that allows this is not given.
    """
    from eskin.app import parse_udp_address
    from eskin.drivers import check_udp_host

    uri = command.source[0]
    if not driver.is_device and not command.allow_simulated_touch:
        raise DeviceError(
            f"--robot {command.robot} is real and {uri} has touches that nobody makes; "
            "allowed are sources that are devices; use --robot sim:ur5, or "
            "--allow-simulated-touch with nobody near the robot"
        )
    if driver.touches == "network" and command.key is None:
        if uri.startswith("udp:"):
            check_udp_host(parse_udp_address(uri)[0], command.allow_remote)
        if not command.allow_unauthenticated:
            raise DeviceError(
                f"--robot {command.robot} is real and packets of {uri} are "
                "unauthenticated; allowed is a network source with --key; give the key "
                "of the patches, or --allow-unauthenticated"
            )


def describe_doubts(command: RunCommand, calibration: "Calibration") -> tuple[str, ...]:
    """Describe why touches and forces may not be what they seem.

    On loopback any program of this computer can send, so it is a network too.
    """
    from eskin.app import find_driver

    doubts = []
    driver = find_driver(command.source)
    if command.key is None and driver.touches == "network":
        doubts.append("unauthenticated: who can send to this port can fake touches")
    if command.ros2 and is_without_joints(command):
        doubts.append(
            "joint positions of /joint_states: who can publish it can misplace touches"
        )
    if command.robot is not None and command.allow_simulated_touch:
        doubts.append("simulated: no person touches")
    if driver.is_device and calibration.source == "nominal":
        doubts.append(
            "not calibrated: forces are relative, by a nominal curve up to "
            f"{calibration.full_scale:,} counts; measure the skin's own with eskin "
            "calibrate, or at least give --bits"
        )
    return tuple(doubts)


def describe_forces(calibration: "Calibration") -> str:
    """Describe how far forces may be from the true ones; empty where it is not known.

    That a skin is not calibrated at all is one of its doubts.
    """
    if calibration.source == "rest":
        return (
            "forces are relative: rest was measured, and gains are those of a data "
            "sheet; eskin calibrate with presses measures them"
        )
    if calibration.gain_deviation is None:
        return ""
    factor = math.exp(CONFIDENCE * float(calibration.gain_deviation.max()))
    return (
        f"forces are within a factor of {factor:.1f} of the true ones, as presses say "
        "(95 %); presses with a gauge, eskin calibrate --force, say more"
    )


def open_command_arm(command: RunCommand, clock: "Clock") -> "Arm | None":
    """Open the arm that touches command; return None without one."""
    from eskin.app import open_arm

    if command.robot is None:
        return None
    output = next(iter(find_outputs(command.ask).values()), None)
    return open_arm(command.robot, clock=clock, question_output=output)


def build_policy(
    command: RunCommand, arm: "Arm", model: "Model", source: "Source"
) -> "Policy":
    """Build the policy that commands the arm.

    Raises:
        CommandError: when the command map cannot be used, or no gesture of the model
            stops the arm.
        ArmError: when the robot of the skin has not the joints of the arm.
    """
    from eskin.command import Policy, load_commands
    from eskin.command.arm import ArmJoints
    from eskin.errors import CommandError

    skin = source.info.skin
    vocabulary = model.card.vocabulary
    ArmJoints(arm, source.info.mounted.robot)
    commands = load_commands(
        command.commands,
        vocabulary,
        skin,
        simulated=not commands_real_robot(command),
    )
    if not any(commands.find_stops(vocabulary, patch) for patch in skin.patches):
        raise CommandError(
            f"{command.commands or 'the default map'} has no gesture of the model that "
            f"pauses or holds the arm; allowed are {', '.join(vocabulary)}; write a "
            "rule for one of them with action: pause, and give its map by --commands"
        )
    return Policy(arm, commands, vocabulary)


def build_listeners(
    command: RunCommand,
    source: "Source",
    recognition: "Recognition",
    arm: "Arm | None",
    policies: "list[Policy]",
    doubts: tuple[str, ...],
) -> "list[Listener]":
    """Build the other listeners: the terminal's, and recorder and viewer if asked."""
    from eskin.cli.terminal import TerminalPrinter
    from eskin.recording import PARTLY_LABELLED, Metadata
    from eskin.stream import Recorder, RecorderConfig

    listeners: list[Listener] = [TerminalPrinter()]
    if command.record is not None:
        piece = None if command.piece_mb is None else round(1e6 * command.piece_mb)
        notes = PARTLY_LABELLED if command.view else {}
        metadata = Metadata("live", "unknown", source.info.uri, notes=notes)
        config = RecorderConfig(piece_bytes=piece)
        listeners.append(Recorder(command.record, metadata, config))
    robot = recognition.recognizer.mounted.robot
    if command.view or command.foxglove:
        say(robot.describe_lacking_meshes("drawn"))
    if command.view:
        from eskin.page import RecordingState
        from eskin.page.process import DEFAULT_PORT, describe_link, free_port
        from eskin.page.viewer import (
            Viewer,
            ViewerConfig,
            describe_question,
            describe_rules,
        )

        port = free_port(DEFAULT_PORT if command.port is None else command.port)
        rules = [describe_rules(policy.commands) for policy in policies]
        commands = tuple(chain.from_iterable(rules))
        page = ViewerConfig(port, warning="; ".join(doubts), commands=commands)
        describe = None
        if command.record is not None:
            describe = partial(RecordingState, str(command.record), True)
        asked = [partial(describe_question, policy) for policy in policies]
        question = asked[0] if asked else None
        listeners.append(
            Viewer(recognition, page, arm=arm, recording=describe, question=question)
        )
        print(describe_link(page.link), flush=True)
    return listeners


def import_buses(command: RunCommand) -> None:
    """Import what --ros2 and --foxglove need.

    Raises:
        ExtraError: it is not installed.
    """
    for name in ("ros2", "foxglove"):
        if getattr(command, name):
            import_module(f"eskin.bus.{name}")


def open_ros2_node(command: RunCommand) -> "Ros2Node | None":
    """Join the domain of ROS 2; return None without --ros2."""
    if not command.ros2:
        return None
    from eskin.bus.ros2 import Ros2Node

    return Ros2Node()


def is_without_joints(command: RunCommand) -> bool:
    """Return whether nothing but a bus can say where the robot's joints are."""
    from eskin.app import find_driver

    options = command.robot, command.q, command.joints
    given = any(option is not None for option in options)
    return not given and find_driver(command.source).is_device


def subscribe_joints(
    robot: "Robot", node: "Ros2Node", clock: "Clock"
) -> "Ros2Joints | None":
    """Subscribe to the joint positions of a robot; return None for one without joints.

    Args:
        robot: robot that wears the skin.
        node: node that subscribes.
        clock: clock that stamps the positions.
    """
    from eskin.bus.ros2 import Ros2Joints

    return Ros2Joints(node, robot, clock) if robot.joint_names else None


def build_publishers(
    command: RunCommand,
    recognition: "Recognition",
    node: "Ros2Node | None",
    joints: "JointSource | JointFunction | None",
) -> "list[Publisher]":
    """Build the listeners that publish to ROS 2 and to Foxglove."""
    if not (command.ros2 or command.foxglove):
        return []
    from eskin.bus import Publisher

    recognizer = recognition.recognizer
    mounted = recognizer.mounted
    gestures = recognizer.model.card.vocabulary
    publishers = []
    drop = choose_drop_policy(command)
    if node is not None:
        from eskin.bus.ros2 import Ros2Bus, Ros2Joints

        bus = Ros2Bus(node, command.ros2_reliable)
        received = joints.diagnose if isinstance(joints, Ros2Joints) else None
        publishers.append(Publisher(bus, mounted, gestures, received, drop))
    if command.foxglove:
        from eskin.bus.foxglove import DEFAULT_PORT, FoxgloveBus, build_asset_finder
        from eskin.page.process import free_port

        port = command.foxglove_port
        number = free_port(DEFAULT_PORT if port is None else port)
        path = Path(command.robot_urdf or "")
        find_asset = None
        if path.is_file():
            find_asset = build_asset_finder(mounted.robot, path.parent)
        bus = FoxgloveBus(number, find_asset)
        publishers.append(Publisher(bus, mounted, gestures, drop=drop))
        print(f"open ws://127.0.0.1:{number} in Foxglove", flush=True)
    return publishers


def print_source(source: "Source", doubts: tuple[str, ...]) -> None:
    """Print the source, its skin and its rate, and doubts about its touches."""
    info = source.info
    print(
        f"{info.uri}: skin '{info.skin.name}', "
        f"{format_count(info.skin.count, 'taxel')} on "
        f"'{info.robot_name}', {info.rate:.3g} scans a second; Ctrl-C ends it",
        flush=True,
    )
    for line in (*doubts, describe_forces(info.calibration), info.describe_rate()):
        say(line)


def summarise(
    source: "Source", stream: "Stream", recognition: "Recognition", commands: int
) -> dict[str, object]:
    """Print and return the counts of the stream and the durations of its steps."""
    counted = source.counters()
    queues = stream.queue_counts()
    skipped = counted.get("skipped", 0)
    dropped = skipped + sum(queue.dropped for queue in queues.values())
    step = recognition.step
    p50, p99 = (1e3 * step.quantile(part) for part in (0.5, 0.99))
    print(
        f"{format_count(counted['readings'], 'reading')}, {dropped} dropped; a step "
        f"took {p50:.2f} ms (p99 {p99:.2f} ms)"
    )
    rest = {key: value for key, value in counted.items() if value}
    print("  " + ", ".join(f"{key} {value}" for key, value in rest.items()))
    return {
        "readings": counted["readings"],
        "dropped": dropped,
        "detections": recognition.detections,
        "commands": commands,
        "step_ms_p50": p50,
        "step_ms_p99": p99,
        "age_ms_p50": 1e3 * recognition.age.quantile(0.5),
        "age_ms_p99": 1e3 * recognition.age.quantile(0.99),
        "source": counted,
        "queues": {name: asdict(queue) for name, queue in queues.items()},
    }
