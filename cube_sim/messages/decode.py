"""
Messages read back: the counterparts of `poses` and `events`.

Each function takes the bytes of one message as they stand in a bag, in either byte order, and
raises MessageError, and nothing else, if they are no message of its type. Arrays are read-only.
"""

from __future__ import annotations

import struct
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cube_sim.messages.cdr import ENCAPSULATION
from cube_sim.messages.cdr_reader import CdrReader, Data, Floats, floats_at
from cube_sim.messages.errors import MessageError

__all__ = [
    'MarkerView',
    'MessageError',
    'Odometry',
    'ParameterEvent',
    'PoseArrayDecoder',
    'PoseArrayView',
    'PoseStamped',
    'read_clock',
    'read_header',
    'read_marker',
    'read_odometry',
    'read_parameter_event',
    'read_pose_array',
    'read_pose_stamped',
]

Parameter = bool | int | float | str | bytes | list[bool] | list[int] | list[float] | list[str]

_POSE_BYTES = 7 * 8
_COVARIANCE_BYTES = 36 * 8
_POINT_BYTES = 3 * 8
_COLOR_BYTES = 4 * 4
_UV_BYTES = 2 * 4
# A parameter: two strings' lengths, kind, bool, and what is left of a value that holds nothing.
_LEAST_PARAMETER_BYTES = 40
_LEAST_STRING_BYTES = 4
_STAMP = struct.Struct('<4xiI')
_COUNT = struct.Struct('<I')
_SECOND = 1_000_000_000


class PoseArrayView(NamedTuple):
    """A geometry_msgs/PoseArray."""

    time_ns: int
    frame_id: str
    poses: Floats
    """(N, 7), x y z qx qy qz qw, m, in `frame_id`."""


class PoseStamped(NamedTuple):
    """A geometry_msgs/PoseStamped."""

    time_ns: int
    frame_id: str
    pose: Floats
    """(7,), x y z qx qy qz qw, m, in `frame_id`."""


class Odometry(NamedTuple):
    """A nav_msgs/Odometry without its covariances."""

    time_ns: int
    frame_id: str
    child_frame_id: str
    pose: Floats
    """(7,), x y z qx qy qz qw, m, in `frame_id`."""
    twist: Floats
    """(6,), vx vy vz wx wy wz, m/s and rad/s, in the axes of the child frame."""


class MarkerView(NamedTuple):
    """The points of a visualization_msgs/Marker."""

    time_ns: int
    frame_id: str
    points: Floats
    """(K, 3), m, in the frame of the marker's pose."""
    colors: NDArray[np.float32]
    """(K, 4), red green blue alpha, or (0, 4)."""


class ParameterEvent(NamedTuple):
    """An rcl_interfaces/ParameterEvent; a parameter that is not set is None."""

    time_ns: int
    node: str
    new: dict[str, Parameter | None]
    changed: dict[str, Parameter | None]
    deleted: list[str]


def read_clock(data: Data) -> int:
    """Return the time of a rosgraph_msgs/Clock, ns."""
    cdr = CdrReader(data, 'rosgraph_msgs/Clock')
    time_ns = cdr.stamp()
    cdr.end()
    return time_ns


def read_header(data: Data) -> tuple[int, str]:
    """Return time, ns, and frame_id of a std_msgs/Header."""
    cdr = CdrReader(data, 'std_msgs/Header')
    header = cdr.header()
    cdr.end()
    return header


def read_pose_array(data: Data) -> PoseArrayView:
    """Return a geometry_msgs/PoseArray; see PoseArrayDecoder for many of one topic."""
    cdr = CdrReader(data, 'geometry_msgs/PoseArray')
    time_ns, frame_id = cdr.header()
    poses = cdr.float64s(7 * cdr.count(_POSE_BYTES))
    cdr.end()
    return PoseArrayView(time_ns, frame_id, poses.reshape(-1, 7))


def read_pose_stamped(data: Data) -> PoseStamped:
    """Return a geometry_msgs/PoseStamped."""
    cdr = CdrReader(data, 'geometry_msgs/PoseStamped')
    time_ns, frame_id = cdr.header()
    pose = cdr.float64s(7)
    cdr.end()
    return PoseStamped(time_ns, frame_id, pose)


def read_odometry(data: Data) -> Odometry:
    """Return a nav_msgs/Odometry."""
    cdr = CdrReader(data, 'nav_msgs/Odometry')
    time_ns, frame_id = cdr.header()
    child_frame_id = cdr.string()
    pose = cdr.float64s(7)
    cdr.raw(_COVARIANCE_BYTES)
    twist = cdr.float64s(6)
    cdr.raw(_COVARIANCE_BYTES)
    cdr.end()
    return Odometry(time_ns, frame_id, child_frame_id, pose, twist)


def read_parameter_event(data: Data) -> ParameterEvent:
    """Return an rcl_interfaces/ParameterEvent."""
    cdr = CdrReader(data, 'rcl_interfaces/ParameterEvent')
    time_ns = cdr.stamp()
    node = cdr.string()
    new, changed, deleted = _parameters(cdr), _parameters(cdr), _parameters(cdr)
    cdr.end()
    return ParameterEvent(time_ns, node, new, changed, list(deleted))


def read_marker(data: Data) -> MarkerView:
    """Return points and colours of a visualization_msgs/Marker."""
    cdr = CdrReader(data, 'visualization_msgs/Marker')
    time_ns, frame_id = cdr.header()
    cdr.string()  # ns
    cdr.int32(), cdr.int32(), cdr.int32()  # id, type, action
    cdr.float64s(10)  # pose, scale
    cdr.raw(_COLOR_BYTES)
    cdr.int32(), cdr.uint32(), cdr.uint8()  # lifetime, frame_locked
    points = cdr.float64s(3 * cdr.count(_POINT_BYTES)).reshape(-1, 3)
    count = cdr.count(_COLOR_BYTES)
    if count not in (0, len(points)):
        raise cdr.error(f'has {len(points)} points and {count} colours')
    colors = np.frombuffer(cdr.raw(_COLOR_BYTES * count), cdr.order + 'f4').reshape(-1, 4)
    cdr.string()  # texture_resource
    cdr.header(), cdr.string(), cdr.raw(cdr.count(1))  # texture
    cdr.raw(_UV_BYTES * cdr.count(_UV_BYTES))
    cdr.string(), cdr.string()  # text, mesh_resource
    cdr.string(), cdr.raw(cdr.count(1)), cdr.uint8()  # mesh_file, mesh_use_embedded_materials
    cdr.end()
    return MarkerView(time_ns, frame_id, points, colors.astype(np.float32))


def _parameters(cdr: CdrReader) -> dict[str, Parameter | None]:
    count = cdr.count(_LEAST_PARAMETER_BYTES)
    return {cdr.string(): _parameter_value(cdr) for _ in range(count)}


def _parameter_value(cdr: CdrReader) -> Parameter | None:
    """Read an rcl_interfaces/ParameterValue, which has a member for each kind of value."""
    kind = cdr.uint8()
    members: list[Parameter | None] = [
        None,
        bool(cdr.uint8()),
        cdr.int64(),
        cdr.float64(),
        cdr.string(),
        cdr.raw(cdr.count(1)),
        [value != 0 for value in cdr.raw(cdr.count(1))],
        cdr.int64s(cdr.count(8)),
        cdr.float64s(cdr.count(8)).tolist(),
        [cdr.string() for _ in range(cdr.count(_LEAST_STRING_BYTES))],
    ]
    if kind >= len(members):
        raise cdr.error(f'has a parameter of the unknown kind {kind}')
    return members[kind]


class PoseArrayDecoder:
    """
    Reads the PoseArrays of one topic, as `read_pose_array` does, at the speed of memory.

    All offsets stay as they are as long as frame_id does and the bytes are little-endian; a
    message that differs is read field by field, and its frame_id is what the next one may have.
    """

    def __init__(self) -> None:
        self._prefix = b''  # the bytes of frame_id, with its length
        self._frame_id = ''
        self._count_at = 0
        self._poses_at = 0

    def __call__(self, data: Data) -> PoseArrayView:
        """Return a geometry_msgs/PoseArray; raises MessageError."""
        poses_at = self._poses_at
        size = len(data) - poses_at
        # An empty array has no padding before its poses, and a padded end is rare: both are read
        # the slow way.
        if (
            not self._prefix
            or size < _POSE_BYTES
            or size % _POSE_BYTES
            or data[:2] != ENCAPSULATION[:2]
            or data[12 : 12 + len(self._prefix)] != self._prefix
        ):
            return self._learn(data)
        count = size // _POSE_BYTES
        seconds, nanoseconds = _STAMP.unpack_from(data)
        if _COUNT.unpack_from(data, self._count_at)[0] != count or nanoseconds >= _SECOND:
            return self._learn(data)
        poses = floats_at(data, poses_at, 7 * count).reshape(count, 7)
        return PoseArrayView(seconds * _SECOND + nanoseconds, self._frame_id, poses)

    def _learn(self, data: Data) -> PoseArrayView:
        view = read_pose_array(data)
        encoded = view.frame_id.encode() + b'\x00'
        self._frame_id = view.frame_id
        self._prefix = _COUNT.pack(len(encoded)) + encoded
        # Alignment counts from behind the encapsulation.
        base = len(ENCAPSULATION)
        behind_name = 12 + len(self._prefix)
        self._count_at = behind_name + (base - behind_name) % 4
        behind_count = self._count_at + 4
        self._poses_at = behind_count + (base - behind_count) % 8
        return view
