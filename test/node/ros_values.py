"""Plain numbers out of messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from rclpy.parameter import parameter_value_to_python

# Nanoseconds of a step, and of a publication, when nothing else is asked for.
STEP = 2_000_000
PERIOD = 20_000_000


def ns(stamp: Any) -> int:
    """The nanoseconds of a builtin_interfaces/Time, or of what has one in its header."""
    if hasattr(stamp, 'header'):
        stamp = stamp.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def xyz(vector: Any) -> np.ndarray:
    """A Point or Vector3, (3,)."""
    return np.array([vector.x, vector.y, vector.z])


def xyzw(quaternion: Any) -> np.ndarray:
    """A Quaternion, (4,)."""
    return np.array([quaternion.x, quaternion.y, quaternion.z, quaternion.w])


def pose7(pose: Any) -> np.ndarray:
    """A Pose, (7,): x y z qx qy qz qw."""
    return np.concatenate([xyz(pose.position), xyzw(pose.orientation)])


def settings_of(event: Any) -> dict[str, Any]:
    """The parameters of a ParameterEvent by name, new or changed."""
    values = {
        parameter.name: parameter_value_to_python(parameter.value)
        for parameter in (*event.new_parameters, *event.changed_parameters)
    }
    return {
        name: value if isinstance(value, (str, int, float)) else list(value)
        for name, value in values.items()
    }


def free_flight(start: np.ndarray, velocity: np.ndarray, seconds: float, step: float) -> np.ndarray:
    """Where a cube is that touches nothing: p0 + v0 t - g t (t + dt) / 2, semi-implicit Euler."""
    gravity = np.array([0.0, 0.0, 9.81])
    return start + velocity * seconds - 0.5 * gravity * seconds * (seconds + step)
