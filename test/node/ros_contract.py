"""What others may rely on, written down a second time: the tests hold the node to this."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray, PoseStamped, Twist
from nav_msgs.msg import Odometry
from rcl_interfaces.msg import Log, ParameterEvent
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_msgs.msg import Header
from std_srvs.srv import SetBool, Trigger
from visualization_msgs.msg import Marker, MarkerArray


@dataclass(frozen=True)
class Channel:
    """A topic's type and delivery."""

    message: Any
    depth: int = 10
    reliable: bool = True
    latched: bool = False

    @property
    def type_name(self) -> str:
        """As in 'geometry_msgs/msg/PoseArray'."""
        return f'{self.message.__module__.split(".")[0]}/msg/{self.message.__name__}'

    @property
    def reliability(self) -> ReliabilityPolicy:
        return ReliabilityPolicy.RELIABLE if self.reliable else ReliabilityPolicy.BEST_EFFORT

    @property
    def durability(self) -> DurabilityPolicy:
        return DurabilityPolicy.TRANSIENT_LOCAL if self.latched else DurabilityPolicy.VOLATILE

    def qos(self) -> QoSProfile:
        """The profile for a subscription that gets all there is."""
        return QoSProfile(
            depth=max(self.depth, 1000), reliability=self.reliability, durability=self.durability
        )


LATCHED = {
    '/cube_sim/ground': Channel(Marker, 1, latched=True),
    '/cube_sim/throws': Channel(Odometry, 1000, latched=True),
    '/cube_sim/settings': Channel(ParameterEvent, 1000, latched=True),
    '/cube_sim/resets': Channel(Header, 1000, latched=True),
    '/cube_sim/camera/pose': Channel(PoseStamped, 1, latched=True),
}
PUBLISHED = {
    **LATCHED,
    '/cube_sim/poses': Channel(PoseArray, 10),
    '/cube_sim/markers': Channel(MarkerArray, 10),
    '/cube_sim/contacts': Channel(Marker, 10),
    '/clock': Channel(Clock, 1, reliable=False),
    '/diagnostics': Channel(DiagnosticArray),
}
SUBSCRIBED = {
    '/cube_sim/camera/set_pose': Channel(PoseStamped),
    '/cube_sim/camera/cmd_vel': Channel(Twist),
}
OTHERS = {'/rosout': Channel(Log, 1000, latched=True)}

SERVICES = {
    'throw': Trigger,
    'reset': Trigger,
    'pause': SetBool,
    'step': Trigger,
    'record': SetBool,
    'next_model': Trigger,
}

PHYSICS = (
    'physics_model',
    'restitution',
    'friction',
    'tangential_factor',
    'gravity',
    'gravity_direction',
    'cube_size',
    'time_step',
    'collide_cubes',
    'restitution_threshold',
    'sleep',
    'sleep_speed',
    'sleep_delay',
    'solver_substep',
    'solver_effort',
)

DEFAULTS = {
    'physics_model': 'simple',
    'restitution': 0.5,
    'friction': 0.5,
    'tangential_factor': 0.9,
    'gravity': 9.81,
    'gravity_direction': [0.0, 0.0, -1.0],
    'cube_size': 0.5,
    'collide_cubes': True,
    'restitution_threshold': 0.02,
    'sleep': True,
    'sleep_speed': 0.01,
    'sleep_delay': 0.5,
    'solver_substep': 0.0011,
    'solver_effort': 1.0,
    'throw_speed': 8.0,
    'throw_spin': [1.0, 2.0, 3.0],
    'max_cubes': 1000,
    'time_step': 0.002,
    'publish_rate': 50.0,
    'real_time_factor': 1.0,
    'start_paused': False,
    'duration': 0.0,
    'scenario': '',
    'record': False,
    'bag_directory': '.',
    'record_markers': False,
    'frame_id': 'world',
    'publish_clock': True,
    'camera.position': [0.0, 0.0, 1.5],
    'camera.orientation': [0.0, 0.0, 0.0, 1.0],
}
