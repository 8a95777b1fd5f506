"""The fixtures of ROS, for this folder."""

from node.ros_fixtures import *  # noqa: F403
