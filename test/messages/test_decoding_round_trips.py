"""Whatever is laid out is read back, in both byte orders, and as rosbags reads it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rosbags.typesys import Stores, get_typestore

from cube_sim.messages import decode, events, markers, poses
from cube_sim.messages.decode import PoseArrayDecoder, read_pose_array

STORE = get_typestore(Stores.ROS2_JAZZY)
# A busy machine may take its time.
patient = settings(max_examples=60, deadline=None)

times = st.integers(-(2**31) * 10**9, 2**31 * 10**9 - 1)
texts = st.text(max_size=20)
numbers = st.floats(width=64, allow_nan=False)
pose_lists = st.integers(0, 6).flatmap(lambda n: arrays(np.float64, (n, 7), elements=numbers))


def big_endian(data: bytes, name: str) -> bytes:
    """The same message as a big-endian machine sends it."""
    return bytes(STORE.serialize_cdr(STORE.deserialize_cdr(data, name), name, little_endian=False))


def both_orders(data: bytes, name: str) -> list[bytes]:
    return [data, big_endian(data, name)]


def moved(data: bytes, by: int) -> memoryview:
    """The same bytes at another place in memory, as within a chunk."""
    return memoryview(bytearray(bytes(by) + data))[by:]


@patient
@given(times)
def test_a_clock(time_ns):
    for data in both_orders(events.clock(time_ns), 'rosgraph_msgs/msg/Clock'):
        assert decode.read_clock(data) == time_ns


@patient
@given(times, texts)
def test_a_header(time_ns, frame_id):
    for data in both_orders(events.header(time_ns, frame_id), 'std_msgs/msg/Header'):
        assert decode.read_header(data) == (time_ns, frame_id)


@patient
@given(times, texts, st.integers(0, 5), st.booleans())
def test_the_points_of_a_marker(time_ns, frame_id, count, colored):
    rng = np.random.default_rng(count)
    points, ways = rng.normal(size=(2, 3 * count, 3))
    shades = rng.random((3 * count, 4)).astype(np.float32)
    if colored:
        data = markers.triangle_list(time_ns, frame_id, 'ground', points, shades)
    else:
        data = markers.contact_lines(time_ns, frame_id, points, ways, 2.0)
        points = np.stack([points, points + ways], axis=1).reshape(-1, 3)
    for order in both_orders(data, 'visualization_msgs/msg/Marker'):
        view = decode.read_marker(order)
        assert (view.time_ns, view.frame_id) == (time_ns, frame_id)
        np.testing.assert_array_equal(view.points, points)
        np.testing.assert_array_equal(view.colors, shades if colored else np.empty((0, 4)))


@patient
@given(times, texts, pose_lists, st.integers(0, 15))
def test_a_pose_array(time_ns, frame_id, array, place):
    data = poses.pose_array(time_ns, frame_id, array)
    for order in both_orders(data, 'geometry_msgs/msg/PoseArray'):
        for found in (read_pose_array(moved(order, place)), PoseArrayDecoder()(order)):
            assert (found.time_ns, found.frame_id) == (time_ns, frame_id)
            assert found.poses.dtype == np.float64
            assert found.poses.flags.aligned
            assert not found.poses.flags.writeable
            np.testing.assert_array_equal(found.poses, array)


@patient
@given(times, texts, arrays(np.float64, 7, elements=numbers))
def test_a_pose_stamped(time_ns, frame_id, pose):
    data = poses.pose_stamped(time_ns, frame_id, pose)
    for order in both_orders(data, 'geometry_msgs/msg/PoseStamped'):
        found = decode.read_pose_stamped(order)
        assert found[:2] == (time_ns, frame_id)
        np.testing.assert_array_equal(found.pose, pose)


@patient
@given(
    times, texts, texts,
    arrays(np.float64, 7, elements=numbers), arrays(np.float64, 6, elements=numbers),
)  # fmt: skip
def test_an_odometry(time_ns, frame_id, child, pose, twist):
    data = events.odometry(time_ns, frame_id, child, pose, twist)
    for order in both_orders(data, 'nav_msgs/msg/Odometry'):
        found = decode.read_odometry(order)
        assert found[:3] == (time_ns, frame_id, child)
        np.testing.assert_array_equal(found.pose, pose)
        np.testing.assert_array_equal(found.twist, twist)


values = st.one_of(
    st.booleans(),
    st.integers(-(2**63), 2**63 - 1),
    numbers,
    texts,
    st.lists(numbers, max_size=4),
)


@patient
@given(times, texts, st.dictionaries(texts, values, max_size=4), st.dictionaries(texts, values))
def test_a_parameter_event(time_ns, node, new, changed):
    data = events.parameter_event(time_ns, node, new, changed)
    for order in both_orders(data, 'rcl_interfaces/msg/ParameterEvent'):
        found = decode.read_parameter_event(order)
        assert found == (time_ns, node, new, changed, [])
        for name, value in {**changed, **new}.items():
            there = found.new.get(name, found.changed.get(name))
            assert type(there) is type(value)


def parameter(name: str, kind: int, **members: Any) -> Any:
    empty: dict[str, Any] = {
        'type': kind, 'bool_value': False, 'integer_value': 0, 'double_value': 0.0,
        'string_value': '', 'byte_array_value': np.empty(0, np.uint8),
        'bool_array_value': np.empty(0, np.bool_), 'integer_array_value': np.empty(0, np.int64),
        'double_array_value': np.empty(0), 'string_array_value': [],
    }  # fmt: skip
    value = STORE.types['rcl_interfaces/msg/ParameterValue'](**{**empty, **members})
    return STORE.types['rcl_interfaces/msg/Parameter'](name, value)


@pytest.mark.parametrize('little_endian', [True, False])
def test_parameters_of_every_kind_that_other_nodes_have(little_endian):
    time = STORE.types['builtin_interfaces/msg/Time'](3, 5)
    kinds = [
        parameter('none', 0),
        parameter('bytes', 5, byte_array_value=np.array([1, 255], np.uint8)),
        parameter('bools', 6, bool_array_value=np.array([True, False, True])),
        parameter('integers', 7, integer_array_value=np.array([-1, 2**62])),
        parameter('doubles', 8, double_array_value=np.array([0.5, -2.0])),
        parameter('texts', 9, string_array_value=['a', '', 'é']),
    ]
    event = STORE.types['rcl_interfaces/msg/ParameterEvent'](
        time, '/n', kinds, [], [parameter('gone', 0)]
    )
    name = 'rcl_interfaces/msg/ParameterEvent'
    data = bytes(STORE.serialize_cdr(event, name, little_endian=little_endian))
    found = decode.read_parameter_event(data)
    assert found.time_ns == 3_000_000_005
    assert found.new == {
        'none': None,
        'bytes': b'\x01\xff',
        'bools': [True, False, True],
        'integers': [-1, 2**62],
        'doubles': [0.5, -2.0],
        'texts': ['a', '', 'é'],
    }
    assert found.deleted == ['gone']


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(times, texts, pose_lists, st.booleans(), st.integers(0, 9)), max_size=8))
def test_one_decoder_for_many_messages_reads_each_as_if_it_were_alone(messages):
    decoder = PoseArrayDecoder()
    for time_ns, frame_id, array, big, place in messages:
        data = poses.pose_array(time_ns, frame_id, array)
        if big:
            data = big_endian(data, 'geometry_msgs/msg/PoseArray')
        for _ in range(2):
            found = decoder(moved(data, place))
            assert found[:2] == (time_ns, frame_id)
            np.testing.assert_array_equal(found.poses, array)


def test_aligned_poses_are_a_view_on_the_messages_own_memory():
    data = bytearray(poses.pose_array(5, 'map', np.arange(14.0).reshape(2, 7)))
    start = len(data) - 14 * 8
    # As memory comes, the poses stand at a multiple of eight or not: try all eight places.
    views = 0
    for place in range(8):
        memory = bytearray(bytes(place) + data)
        found = read_pose_array(memoryview(memory)[place:])
        memory[place + start :] = bytes(14 * 8)
        views += not found.poses.any()
    assert views == 1


def test_padding_may_hold_anything():
    data = bytearray(poses.pose_array(5, 'world', np.ones((1, 7))))
    name_end = 4 + 8 + 4 + len('world') + 1
    data[name_end : name_end + 2] = b'\xaa\xbb'
    decoder = PoseArrayDecoder()
    for read in (read_pose_array, decoder, decoder):
        assert read(bytes(data)).poses.tolist() == [[1.0] * 7]
        assert read(bytes(data) + b'\x00').poses.tolist() == [[1.0] * 7]


def test_an_empty_string_of_length_zero_is_one():
    assert decode.read_header(b'\x00\x01\x00\x00' + bytes(12)) == (0, '')
