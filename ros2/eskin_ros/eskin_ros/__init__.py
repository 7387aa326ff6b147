"""This package is a node of ROS 2 that publishes a robot's electronic skin."""
