"""cube_sim: an exact ROS 2 simulator of cubes thrown onto a plane."""

__version__ = '0.1.0'
