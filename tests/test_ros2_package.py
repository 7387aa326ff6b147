"""Tests of the package `ros2/eskin_ros` with stand-ins for what only ROS 2 has."""

import importlib.util
import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from xml.etree import ElementTree

import pytest
import yaml

from eskin.bus import (
    COMMAND_EVENT,
    DIAGNOSTICS,
    LEFT_TO_ROS,
    PUBLISHED,
    SENSOR_TOPICS,
)
from eskin.drivers import HostClock
from eskin.errors import JointsError
from helpers.live import mounted, scans
from helpers.questions import DECISIONS
from test_bus_messages import publish

pytestmark = pytest.mark.slow

PACKAGE = Path(__file__).parents[1] / "ros2" / "eskin_ros"


class NodeStandIn:
    """Keeps what a node is asked for."""

    def __init__(self, **given):
        self.given = given
        self.declared = {}
        self.made = {}
        self.gone = []
        self.callbacks = {}

    def declare_parameter(self, name, default):
        self.declared[name] = default
        return SimpleNamespace(value=self.given.get(name, default))

    def create_publisher(self, kind, topic, profile):
        sent = []
        self.made[topic] = SimpleNamespace(
            kind=kind,
            profile=profile,
            sent=sent,
            publish=sent.append,
            get_subscription_count=lambda: 1,
        )
        return self.made[topic]

    def create_subscription(self, kind, topic, callback, depth):
        self.callbacks[topic] = callback

    def destroy_publisher(self, publisher):
        self.gone.append(publisher)


@pytest.fixture
def node(monkeypatch):
    """The module of the node, whose imports of ROS 2 are stand-ins."""
    best = SimpleNamespace(BEST_EFFORT="best", RELIABLE="reliable")
    stand_ins = {
        "rclpy": {},
        "rclpy.node": {"Node": NodeStandIn},
        "rclpy.qos": {"QoSProfile": SimpleNamespace, "ReliabilityPolicy": best},
        "rosidl_runtime_py": {},
        "rosidl_runtime_py.utilities": {"get_message": lambda name: name},
        "sensor_msgs": {},
        "sensor_msgs.msg": {"JointState": SimpleNamespace},
    }
    for name, values in stand_ins.items():
        module = ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)
    spec = importlib.util.spec_from_file_location(
        "eskin_node", PACKAGE / "eskin_ros" / "node.py"
    )
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "eskin_node", module)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("reliable", [False, True])
def test_node_publishes_every_topic_encoded_with_its_quality_of_service(node, reliable):
    own = NodeStandIn()
    publish(node.NodeBus(own, reliable), scans(mounted("ur5"), [], 50, 1.2))
    assert {topic.name for topic in PUBLISHED} <= set(own.made)
    assert not {topic.name for topic in LEFT_TO_ROS} & set(own.made)
    sensor = {topic.name for topic in SENSOR_TOPICS}
    for name, made in own.made.items():
        best = name in sensor and not reliable
        assert made.profile.reliability == ("best" if best else "reliable")
        assert made.profile.depth == (5 if name in sensor else 10)
    assert own.made[DIAGNOSTICS.name].kind == DIAGNOSTICS.type_name
    assert all(isinstance(data, bytes) for data in own.made["/eskin/taxels"].sent)
    assert len(own.made[COMMAND_EVENT.name].sent) == len(DECISIONS)
    assert own.made["/eskin/taxels"].sent and len(own.gone) == len(own.made)


def test_parameters_are_those_of_the_file_and_have_its_defaults(node):
    own = NodeStandIn(source=["udp://127.0.0.1:9750"], skin="ur5")
    given = node.read_parameters(own)
    assert given.source == ("udp://127.0.0.1:9750",) and given.skin == "ur5"
    text = (PACKAGE / "config" / "eskin.yaml").read_text()
    assert yaml.safe_load(text)["eskin"]["ros__parameters"] == own.declared


def test_joint_states_are_taken_by_name_and_refused_where_they_cannot_be_used(node):
    own = NodeStandIn()
    on = mounted("ur5")
    clock = HostClock()
    q_at = node.subscribe_joints(own, on, clock)
    push = own.callbacks["/joint_states"]
    names = [*on.robot.joint_names][::-1]
    push(SimpleNamespace(name=names, position=[0.1]))
    with pytest.raises(JointsError):
        q_at(clock.now())
    positions = [0.1 * n for n in range(len(names))]
    push(SimpleNamespace(name=[*names, "other"], position=[*positions, 9.0]))
    assert q_at(clock.now()).tolist() == pytest.approx(positions[::-1])


def test_version_and_name_are_the_same_everywhere():
    package = ElementTree.parse(PACKAGE / "package.xml")
    messages = ElementTree.parse(
        PACKAGE.parents[1] / "msg" / "eskin_msgs" / "package.xml"
    )
    assert package.findtext("name") == PACKAGE.name
    assert package.findtext("version") == messages.findtext("version")
    assert (
        f'version="{package.findtext("version")}"' in (PACKAGE / "setup.py").read_text()
    )
    assert package.findtext("export/build_type") == "ament_python"


@pytest.mark.parametrize(
    "path", sorted((PACKAGE / "launch").glob("*.py")), ids=lambda path: path.name
)
def test_launch_files_start_the_node_with_parameters_that_it_has(
    path, node, monkeypatch
):
    def keep(*args, **options):
        return SimpleNamespace(args=args, **options)

    stand_ins = {
        "launch": {"LaunchDescription": list},
        "launch.actions": {"DeclareLaunchArgument": keep},
        "launch.substitutions": {"LaunchConfiguration": str},
        "launch_ros": {},
        "launch_ros.actions": {"Node": keep},
    }
    for name, values in stand_ins.items():
        module = ModuleType(name)
        vars(module).update(values)
        monkeypatch.setitem(sys.modules, name, module)
    *arguments, started = runpy.run_path(str(path))["generate_launch_description"]()
    assert (started.package, started.executable) == ("eskin_ros", "eskin_node")
    [parameters] = started.parameters
    own = NodeStandIn()
    node.read_parameters(own)
    assert set(parameters) <= set(own.declared)
    assert {each.args[0] for each in arguments} <= set(own.declared)
