"""The node `eskin` recognises touches live and publishes what the skin feels.

Topics and messages are those of `eskin run --ros2`, here as a node that ROS 2 lists,
with parameters. Messages are encoded by eskin and published as they are.
"""

import sys
import threading
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosidl_runtime_py.utilities import get_message
from sensor_msgs.msg import JointState

from eskin.app import SourceConfig, open_source
from eskin.bus import LEFT_TO_ROS, SENSOR_TOPICS, Bus, Publisher
from eskin.drivers import HostClock
from eskin.drivers.joints import ReceivedJoints, check_positions
from eskin.errors import EskinError
from eskin.live import Recognizer, load_model, warm_up
from eskin.recording.cdr import Topic
from eskin.skin import MountedSkin, mount_skin
from eskin.stream import Recognition, Stream

SENSOR_DEPTH = 5
DEPTH = 10
"""Numbers of messages that are kept for a slow receiver, of sensor data and others."""


@dataclass(frozen=True)
class Parameters:
    """The parameters of the node; an empty text is none."""

    source: tuple[str, ...] = ("sim:ur5",)
    """URIs of the source, as of `eskin run --source`."""

    model: str = "ur5"
    """Name of weights that come with eskin, or a model file."""

    skin: str = ""
    """Skin of a device: a preset's name or a folder."""

    robot_urdf: str = ""
    """Robot of the skin: a URDF file or a preset's name; by default the skin's own."""

    calibration: str = ""
    """Calibration file of the electronics."""

    use_joint_states: bool = False
    """Whether joint positions come from `/joint_states`, by name."""

    reliable: bool = False
    """Whether sensor data is sent again when it is lost."""


def read_parameters(node: Any) -> Parameters:  # noqa: ANN401
    """Declare the parameters of a node, and return their values."""
    values = {}
    for each in fields(Parameters):
        default = list(each.default) if each.name == "source" else each.default
        value = node.declare_parameter(each.name, default).value
        values[each.name] = tuple(value) if each.name == "source" else value
    return Parameters(**values)


class NodeBus(Bus):
    """Publishes encoded messages as a node of ROS 2."""

    name = "ros2"

    def __init__(self, node: Any, reliable: bool) -> None:  # noqa: ANN401
        """Publish as a node; sensor data is best effort unless it is reliable."""
        self.node = node
        self.reliable = reliable
        self.publishers: dict[str, Any] = {}

    def open(self, topics: tuple[Topic, ...]) -> None:
        """Create the publishers of the topics that are not left to others."""
        for topic in topics:
            if topic in LEFT_TO_ROS:
                continue
            is_sensor = topic in SENSOR_TOPICS
            best = ReliabilityPolicy.BEST_EFFORT
            is_best = is_sensor and not self.reliable
            profile = QoSProfile(
                depth=SENSOR_DEPTH if is_sensor else DEPTH,
                reliability=best if is_best else ReliabilityPolicy.RELIABLE,
            )
            kind = get_message(topic.type_name)
            made = self.node.create_publisher(kind, topic.name, profile)
            self.publishers[topic.name] = made

    def wants(self, topic: Topic) -> bool:
        """Return whether anybody subscribes to a topic."""
        publisher = self.publishers.get(topic.name)
        return publisher is not None and publisher.get_subscription_count() > 0

    def send(self, topic: Topic, stamp: int, data: bytes) -> None:
        """Publish an encoded message."""
        if topic.name in self.publishers:
            self.publishers[topic.name].publish(data)

    def close(self) -> None:
        """Destroy the publishers."""
        for publisher in self.publishers.values():
            self.node.destroy_publisher(publisher)
        self.publishers.clear()


def subscribe_joints(node: Any, mounted: MountedSkin, clock: HostClock) -> Any:  # noqa: ANN401
    """Subscribe to `/joint_states`; return the function of their positions by time."""
    received = ReceivedJoints(mounted.robot)
    lock = threading.Lock()

    def take_message(message: JointState) -> None:
        with lock:
            try:
                pairs = zip(message.name, message.position, strict=True)
                own = {name: q for name, q in pairs if name in received.index}
                q = check_positions(list(own.values()), mounted.robot, list(own))
            except ValueError as error:
                received.refuse(str(error))
                return
            received.merge_positions(dict(zip(own, q, strict=True)), clock.now())

    def q_at(stamp: int) -> Any:  # noqa: ANN401
        with lock:
            return received.q_at(stamp)

    node.create_subscription(JointState, "/joint_states", take_message, SENSOR_DEPTH)
    return q_at


def build_stream(node: Any, given: Parameters) -> Stream:  # noqa: ANN401
    """Open the source, and build the stream that recognises and publishes."""
    clock = HostClock()
    model = load_model(given.model)
    joints = None
    if given.use_joint_states and given.skin:
        mounted = mount_skin(given.skin, given.robot_urdf or None)
        joints = subscribe_joints(node, mounted, clock)
    config = SourceConfig(
        skin=given.skin or None,
        robot=given.robot_urdf or None,
        calibration=Path(given.calibration) if given.calibration else None,
        joints=joints,
    )
    source = open_source(*given.source, config=config, clock=clock)
    robot = source.info.load_robot(given.robot_urdf or None)
    mounted = MountedSkin(source.info.skin, robot)
    recognizer = Recognizer(model, mounted, source.info.calibration)
    warm_up(recognizer)
    bus = NodeBus(node, given.reliable)
    publisher = Publisher(bus, mounted, model.card.vocabulary)
    return Stream(source, [Recognition(recognizer), publisher])


def main() -> None:
    """Run the node until its source ends or it is stopped."""
    rclpy.init()
    node = Node("eskin")
    spinner = threading.Thread(target=rclpy.spin, args=(node,), daemon=True)
    try:
        given = read_parameters(node)
        spinner.start()
        with build_stream(node, given) as stream:
            stream.wait()
    except KeyboardInterrupt:
        pass
    except EskinError as error:
        node.get_logger().fatal(str(error))
        sys.exit(2)
    finally:
        rclpy.try_shutdown()


if __name__ == "__main__":
    main()
