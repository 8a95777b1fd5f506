"""What happens between steps, on the wire: throws, settings, resets, and the clock."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from cube_sim.messages.cdr import CdrWriter

Floats = NDArray[np.float64]
Value = bool | int | float | str | Sequence[float]

# The member of rcl_interfaces/ParameterValue that holds a value of each kind.
_BOOL, _INTEGER, _DOUBLE, _STRING, _DOUBLE_ARRAY = 1, 2, 3, 4, 8


def clock(time_ns: int) -> bytes:
    """Lay out a rosgraph_msgs/Clock."""
    cdr = CdrWriter()
    cdr.stamp(time_ns)
    return cdr.message()


def header(time_ns: int, frame_id: str) -> bytes:
    """Lay out a std_msgs/Header."""
    cdr = CdrWriter()
    cdr.header(time_ns, frame_id)
    return cdr.message()


def odometry(
    time_ns: int, frame_id: str, child_frame_id: str, pose: Floats, twist: Floats
) -> bytes:
    """
    Lay out a nav_msgs/Odometry with covariances of zero: the state is exact.

    `pose` (7,) in `frame_id`; `twist` (6,), vx vy vz wx wy wz, in the axes of the child frame, as
    the message is defined.
    """
    cdr = CdrWriter()
    cdr.header(time_ns, frame_id)
    cdr.string(child_frame_id)
    cdr.float64s(*pose)
    cdr.raw(bytes(36 * 8))
    cdr.float64s(*twist)
    cdr.raw(bytes(36 * 8))
    return cdr.message()


def parameter_event(
    time_ns: int, node: str, new: Mapping[str, Value], changed: Mapping[str, Value]
) -> bytes:
    """Lay out an rcl_interfaces/ParameterEvent; nothing in it is deleted."""
    cdr = CdrWriter()
    cdr.stamp(time_ns)
    cdr.string(node)
    for parameters in (new, changed):
        cdr.uint32(len(parameters))
        for name, value in parameters.items():
            cdr.string(name)
            _parameter_value(cdr, value)
    cdr.uint32(0)
    return cdr.message()


def _parameter_value(cdr: CdrWriter, value: Value) -> None:
    kind = _kind(value)
    cdr.uint8(kind)
    cdr.uint8(bool(value) if kind == _BOOL else 0)
    cdr.int64(value if isinstance(value, int) and kind == _INTEGER else 0)
    cdr.float64s(value if isinstance(value, float) else 0.0)
    cdr.string(value if isinstance(value, str) else '')
    cdr.uint32(0)  # byte_array_value
    cdr.uint32(0)  # bool_array_value
    cdr.uint32(0)  # integer_array_value
    if isinstance(value, Sequence) and not isinstance(value, str):
        cdr.uint32(len(value))
        if value:
            cdr.float64s(*value)
    else:
        cdr.uint32(0)
    cdr.uint32(0)  # string_array_value


def _kind(value: Value) -> int:
    if isinstance(value, bool):
        return _BOOL
    if isinstance(value, int):
        return _INTEGER
    if isinstance(value, float):
        return _DOUBLE
    return _STRING if isinstance(value, str) else _DOUBLE_ARRAY
