"""Show a simulated person who touches a simulated skin."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node


def generate_launch_description() -> LaunchDescription:
    """Start the node with a simulation."""
    source = LaunchConfiguration("source")
    return LaunchDescription(
        [
            DeclareLaunchArgument("source", default_value="sim:ur5"),
            Node(
                package="eskin_ros",
                executable="eskin_node",
                name="eskin",
                parameters=[{"source": [source]}],
                output="screen",
            ),
        ]
    )
