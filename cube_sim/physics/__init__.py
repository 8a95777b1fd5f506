"""
The laws: cubes that fly, touch the plane z = 0 and answer by a chosen model.

numpy and numba only: no ROS, no files, no clock. SI units; frame `world`, right-handed,
z up (REP-103); quaternions are stored x, y, z, w as in `geometry_msgs/Pose`.
"""

from cube_sim.physics.models import MODELS
from cube_sim.physics.settings import PhysicsError, Settings
from cube_sim.physics.world import World

__all__ = ['MODELS', 'PhysicsError', 'Settings', 'World']
