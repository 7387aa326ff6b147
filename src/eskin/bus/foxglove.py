"""This module serves a stream to Foxglove over its WebSocket protocol."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, final

from eskin.bus.messages import ROBOT_DESCRIPTION
from eskin.bus.publisher import Bus
from eskin.errors import DeviceError, RobotError
from eskin.files import read_file
from eskin.recording.cdr import Topic
from eskin.registry import find_package
from eskin.robot import Robot
from eskin.robot.meshes import MAX_MESH_BYTES, MeshReader
from eskin.robot.urdf import parse_xml

foxglove = find_package("foxglove", "foxglove-sdk", "foxglove", "--foxglove")
websocket = find_package("foxglove.websocket", "foxglove-sdk", "foxglove", "--foxglove")

HOST = "127.0.0.1"
DEFAULT_PORT = 8765
"""TCP port that Foxglove opens by default."""
NAME = "eskin"


@final
class FoxgloveBus(Bus):
    """Serves topics on a port of this computer; clients can receive, not send.

    Attributes:
        server: the server; None before the start and after the end.
    """

    name = "foxglove"

    def __init__(
        self,
        port: int = DEFAULT_PORT,
        find_asset: Callable[[str], bytes | None] | None = None,
    ) -> None:
        """Prepare the server.

        Args:
            port: port of 127.0.0.1; 0 for any free one.
            find_asset: function that returns the file of an address in the robot's
                URDF, or None.
        """
        self.number = port
        self.find_asset = find_asset
        self.context = foxglove.Context()
        self.channels: dict[str, Any] = {}
        self.latest: bytes | None = None
        self.server: Any = None

    @property
    def port(self) -> int:
        """Port that is served."""
        return self.server.port if self.server is not None else self.number

    def open(self, topics: tuple[Topic, ...]) -> None:
        """Declare the topics, and serve them.

        Raises:
            DeviceError: the port is not free.
        """
        for topic in topics:
            definition = topic.definition.encode()
            schema = foxglove.Schema(
                name=topic.type_name, encoding="ros2msg", data=definition
            )
            self.channels[topic.name] = foxglove.Channel(
                topic.name, schema=schema, message_encoding="cdr", context=self.context
            )
        try:
            self.server = foxglove.start_server(
                name=NAME,
                host=HOST,
                port=self.number,
                context=self.context,
                asset_handler=self.find_asset,
                server_listener=DescriptionSender(self),
            )
        except (RuntimeError, OSError) as error:
            raise DeviceError(
                f"cannot serve Foxglove on port {self.number} ({error}); allowed is a "
                "free port of this computer; give another with --foxglove-port"
            ) from error

    def wants(self, topic: Topic) -> bool:
        """Return whether a client has subscribed to the topic."""
        channel = self.channels.get(topic.name)
        return channel is not None and channel.has_sinks()

    def send(self, topic: Topic, stamp: int, data: bytes) -> None:
        """Send a message to the clients that have subscribed to its topic."""
        if topic == ROBOT_DESCRIPTION:
            self.latest = data
        self.channels[topic.name].log(data, log_time=stamp)

    def send_description(self, client: int | None) -> None:
        """Send the robot's description to a client that has just subscribed to it."""
        if self.latest is not None:
            channel = self.channels[ROBOT_DESCRIPTION.name]
            channel.log(self.latest, sink_id=client)

    def close(self) -> None:
        """Stop the server."""
        server = self.server
        self.server = None
        if server is not None:
            server.stop()


@final
class DescriptionSender(websocket.ServerListener):
    """Sends the robot's description once more to each client that subscribes to it."""

    def __init__(self, bus: FoxgloveBus) -> None:
        """Send what a bus has sent last."""
        self.bus = bus

    def on_subscribe(self, client: Any, channel: Any) -> None:  # noqa: ANN401
        """Send the description if the channel is for it."""
        if channel.topic == ROBOT_DESCRIPTION.name:
            self.bus.send_description(getattr(client, "sink_id", None))


def build_asset_finder(robot: Robot, folder: Path) -> Callable[[str], bytes | None]:
    """Return a function that reads the mesh files that a robot's URDF names, and those.

    Args:
        robot: the robot.
        folder: folder of its URDF.
    """
    root = parse_xml(robot.urdf, folder / robot.name)
    allowed = {mesh.get("filename") for mesh in root.iter("mesh")}
    reader = MeshReader(folder)

    def find_asset(address: str) -> bytes | None:
        if address not in allowed:
            return None
        try:
            return read_file(reader.find(address, "robot"), MAX_MESH_BYTES)
        except (RobotError, OSError):
            return None

    return find_asset
