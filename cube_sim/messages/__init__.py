"""
The memory of the simulation as the bytes of ROS messages (CDR, little-endian), and back.

Layouts only: no topics, no files, no ROS library. Padding is zero, so equal content is equal
bytes. Times are simulated nanoseconds; the arrays are those of `cube_sim.physics`. `decode` reads
such bytes, of either byte order, and raises MessageError alone.
"""
