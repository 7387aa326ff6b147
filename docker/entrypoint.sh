#!/bin/sh
set -e
. "/opt/ros/$ROS_DISTRO/setup.sh"
. /opt/ws/install/setup.sh
exec "$@"
