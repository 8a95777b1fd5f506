"""Topics and messages for the recording tests, made without ROS running."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from mcap.exceptions import EndOfFile
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rosbags.highlevel import AnyReader
from rosbags.typesys import Stores, get_typestore

from cube_sim.recording import Topic

STORE = get_typestore(Stores.ROS2_JAZZY)


def _new(name: str, *values: Any) -> Any:
    package, message = name.split('/')
    return STORE.types[f'{package}/msg/{message}'](*values)


def _header(stamp_ns: int, frame_id: str) -> Any:
    stamp = _new('builtin_interfaces/Time', *divmod(stamp_ns, 10**9))
    return _new('std_msgs/Header', stamp, frame_id)


def _poses(stamp_ns: int, count: int) -> bytes:
    poses = [
        _new(
            'geometry_msgs/Pose',
            _new('geometry_msgs/Point', stamp_ns * 1e-9, -0.1 * index, 1 / (1 + index)),
            _new('geometry_msgs/Quaternion', 0.0, 0.6, 0.0, -0.8),
        )
        for index in range(count)
    ]
    message = _new('geometry_msgs/PoseArray', _header(stamp_ns, 'world'), poses)
    return bytes(STORE.serialize_cdr(message, 'geometry_msgs/msg/PoseArray'))


def _reset(stamp_ns: int) -> bytes:
    return bytes(STORE.serialize_cdr(_header(stamp_ns, 'reset é'), 'std_msgs/msg/Header'))


def _clock(stamp_ns: int) -> bytes:
    message = _new('rosgraph_msgs/Clock', _new('builtin_interfaces/Time', *divmod(stamp_ns, 10**9)))
    return bytes(STORE.serialize_cdr(message, 'rosgraph_msgs/msg/Clock'))


def _read(path: Path) -> list[tuple[str, int, bytes]]:
    with AnyReader([path]) as reader:
        return [(link.topic, time_ns, bytes(data)) for link, time_ns, data in reader.messages()]


def _read_unfinished(path: Path) -> list[tuple[int, bytes]]:
    found = []
    with path.open('rb') as stream:
        try:
            for record in StreamReader(stream, validate_crcs=True).records:
                if isinstance(record, Message):
                    found.append((record.log_time, record.data))
        except EndOfFile:
            return found
    raise AssertionError(f'{path} is finished')


@pytest.fixture(scope='session')
def make() -> SimpleNamespace:
    """CDR bytes of a message: poses(stamp_ns, count), reset(stamp_ns), clock(stamp_ns)."""
    return SimpleNamespace(poses=_poses, reset=_reset, clock=_clock)


@pytest.fixture(scope='session')
def read_bag() -> Any:
    """Read a bag with rosbags: (topic, log time, data) of each message."""
    return _read


@pytest.fixture(scope='session')
def read_unfinished() -> Any:
    """Read an MCAP file that ends without an index: (log time, data) of each message."""
    return _read_unfinished


@pytest.fixture(scope='session')
def topics() -> list[Topic]:
    return [
        Topic('/cube_sim/resets', 'std_msgs/msg/Header', durability='transient_local', depth=100),
        Topic('/cube_sim/poses', 'geometry_msgs/msg/PoseArray'),
        Topic('/clock', 'rosgraph_msgs/msg/Clock', reliability='best_effort', depth=1),
    ]
