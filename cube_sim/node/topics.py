"""The topics of the node: name, type, quality of service."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseStamped, Twist
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import ParameterEvent
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from cube_sim.recording import Topic
from cube_sim.simulation import simulation

DIAGNOSTICS, CONTACTS = '/diagnostics', simulation.CONTACTS
CAMERA_SET_POSE, CAMERA_CMD_VEL = '~/camera/set_pose', '~/camera/cmd_vel'

# How many throws, settings and resets whoever comes late can still get.
DEEP = 10_000


@dataclass(frozen=True)
class TopicSpec:
    """A topic as people know it: private name, message class, and how it is delivered."""

    name: str
    message: Any
    summary: str
    reliable: bool = True
    latched: bool = False
    depth: int = 10

    @property
    def type_name(self) -> str:
        """The full name of the type, as in 'geometry_msgs/msg/PoseArray'."""
        package = self.message.__module__.split('.')[0]
        return f'{package}/msg/{self.message.__name__}'

    def qos(self) -> QoSProfile:
        """Return the profile for a publisher or subscription."""
        return QoSProfile(
            depth=self.depth,
            reliability=(
                ReliabilityPolicy.RELIABLE if self.reliable else ReliabilityPolicy.BEST_EFFORT
            ),
            durability=(
                DurabilityPolicy.TRANSIENT_LOCAL if self.latched else DurabilityPolicy.VOLATILE
            ),
        )

    def recorded(self, resolved_name: str) -> Topic:
        """Return what a bag has to know about it."""
        return Topic(
            resolved_name,
            self.type_name,
            reliability='reliable' if self.reliable else 'best_effort',
            durability='transient_local' if self.latched else 'volatile',
            depth=self.depth,
        )


# In the order in which a bag lists them.
PUBLISHED: tuple[TopicSpec, ...] = (
    TopicSpec(simulation.GROUND, Marker, 'the height map that marks the plane', True, True, 1),
    TopicSpec(simulation.SETTINGS, ParameterEvent, 'all physics settings', True, True, DEEP),
    TopicSpec(simulation.CAMERA_POSE, PoseStamped, 'where cubes are thrown from', True, True, 1),
    TopicSpec(simulation.THROWS, Odometry, 'the exact state of each throw', True, True, DEEP),
    TopicSpec(simulation.RESETS, Header, 'one for each reset', True, True, DEEP),
    TopicSpec(simulation.POSES, PoseArray, 'every cube, in throw order'),
    TopicSpec(simulation.MARKERS, MarkerArray, 'a CUBE for each, id = index'),
    TopicSpec(simulation.CONTACTS, Marker, 'contact points and normals, model contact'),
    TopicSpec(simulation.CLOCK, Clock, 'simulation time', False, False, 1),
    TopicSpec(DIAGNOSTICS, DiagnosticArray, 'how the run is going, 1 Hz of wall time'),
)
SUBSCRIBED: tuple[TopicSpec, ...] = (
    TopicSpec(CAMERA_SET_POSE, PoseStamped, 'places the camera'),
    TopicSpec(CAMERA_CMD_VEL, Twist, 'flies the camera, in its own axes'),
)
