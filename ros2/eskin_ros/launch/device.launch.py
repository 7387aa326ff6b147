"""Run a real skin on a robot whose joint states another node publishes."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Start the node with a device."""
    names = ("source", "skin", "robot_urdf", "model", "calibration")
    defaults = {"robot_urdf": "", "model": "ur5", "calibration": ""}
    values = {name: LaunchConfiguration(name) for name in names}
    parameters = {**values, "source": [values["source"]], "use_joint_states": True}
    return LaunchDescription(
        [
            *(
                DeclareLaunchArgument(name, default_value=defaults[name])
                if name in defaults
                else DeclareLaunchArgument(name)
                for name in names
            ),
            Node(
                package="eskin_ros",
                executable="eskin_node",
                name="eskin",
                parameters=[parameters],
                output="screen",
            ),
        ]
    )
