"""Poses on the wire: PoseArray for the cubes, PoseStamped for the camera."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from cube_sim.messages.cdr import CdrWriter

Floats = NDArray[np.float64]


def pose_array(time_ns: int, frame_id: str, poses: Floats) -> bytes:
    """Lay out a geometry_msgs/PoseArray from `poses` (N, 7), x y z qx qy qz qw, m."""
    cdr = CdrWriter()
    cdr.header(time_ns, frame_id)
    cdr.uint32(len(poses))
    if len(poses):
        cdr.align(8)
        cdr.raw(np.ascontiguousarray(poses, '<f8').data.cast('B'))
    return cdr.message()


def pose_stamped(time_ns: int, frame_id: str, pose: Sequence[float] | Floats) -> bytes:
    """Lay out a geometry_msgs/PoseStamped from one pose (7,), x y z qx qy qz qw, m."""
    cdr = CdrWriter()
    cdr.header(time_ns, frame_id)
    cdr.float64s(*pose)
    return cdr.message()
