"""Every layout, read by rclpy and by rosbags; see `ros_messages.read_by_both` for what holds."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import settings as hypothesis_settings
from hypothesis import strategies as st
from support.physics_states import Draw
from support.ros_messages import read_by_both

from cube_sim.messages import events, markers, poses
from cube_sim.messages.cdr import CdrWriter

# Every way in which a string can end between two multiples of eight, and UTF-8.
FRAMES = [
    '',
    'w',
    'wo',
    'wor',
    'worl',
    'world',
    'world6',
    'world_7',
    'world__8',
    'world___9',
    'épée',
]
TIMES = [0, 1, 999_999_999, 1_000_000_000, 123_456_789_012, (2**31 - 1) * 10**9 + 7]


def stamp(time_ns: int) -> dict[str, int]:
    return {'sec': time_ns // 10**9, 'nanosec': time_ns % 10**9}


def header(time_ns: int, frame_id: str) -> dict[str, object]:
    return {'stamp': stamp(time_ns), 'frame_id': frame_id}


def pose(row) -> dict[str, object]:
    return {
        'position': dict(zip('xyz', row[:3], strict=True)),
        'orientation': dict(zip('xyzw', row[3:], strict=True)),
    }


def rows(count: int, seed: int = 1) -> np.ndarray:
    draw = Draw(seed)
    return np.array([draw.vector(-9.0, 9.0, 7) for _ in range(count)]).reshape(count, 7)


@pytest.mark.parametrize('time_ns', TIMES)
def test_a_clock_reads_as_it_was_written(time_ns):
    assert read_by_both(events.clock(time_ns), 'rosgraph_msgs/msg/Clock') == {
        'clock': stamp(time_ns)
    }


@pytest.mark.parametrize('time_ns', TIMES)
def test_a_header_reads_as_it_was_written(time_ns):
    for frame_id in FRAMES:
        data = events.header(time_ns, frame_id)
        assert read_by_both(data, 'std_msgs/msg/Header') == header(time_ns, frame_id)


@pytest.mark.parametrize('count', [0, 1, 2, 3, 100])
def test_a_pose_array_reads_as_it_was_written(count):
    for frame_id in FRAMES:
        values = rows(count)
        data = poses.pose_array(2_000_000_003, frame_id, values)
        assert read_by_both(data, 'geometry_msgs/msg/PoseArray') == {
            'header': header(2_000_000_003, frame_id),
            'poses': [pose(row) for row in values.tolist()],
        }


def test_a_pose_array_does_not_care_how_its_numbers_lie_in_memory():
    values = rows(6)
    data = poses.pose_array(5, 'world', values)
    assert poses.pose_array(5, 'world', np.asfortranarray(values)) == data
    assert poses.pose_array(5, 'world', np.repeat(values, 2, axis=0)[::2]) == data
    assert poses.pose_array(5, 'world', values.astype('>f8')) == data


def test_numbers_that_are_no_numbers_keep_their_bits():
    # -0, the least, the largest, an infinity and a NaN with a payload.
    odd = struct.unpack('<d', struct.pack('<Q', 0x7FF8_0000_0000_1234))[0]
    values = np.array([[-0.0, 5e-324, 1.7976931348623157e308, np.inf, -np.inf, odd, 0.1]])
    assert poses.pose_array(0, 'world', values)[-56:] == values.tobytes()


def test_a_stamped_pose_reads_as_it_was_written():
    for frame_id in FRAMES:
        row = rows(1)[0]
        expected = {'header': header(7, frame_id), 'pose': pose(row.tolist())}
        data = poses.pose_stamped(7, frame_id, row)
        assert read_by_both(data, 'geometry_msgs/msg/PoseStamped') == expected
        assert poses.pose_stamped(7, frame_id, row.tolist()) == data


@pytest.mark.parametrize('child', ['', 'cube_0', 'cube_10', 'cube_100', 'cube_1000'])
def test_an_odometry_reads_as_it_was_written(child):
    for frame_id in FRAMES:
        state, twist = rows(1)[0], np.arange(6) + 0.5
        data = events.odometry(3_000_000_001, frame_id, child, state, twist)
        linear, angular = (
            dict(zip('xyz', part, strict=True)) for part in twist.reshape(2, 3).tolist()
        )
        assert read_by_both(data, 'nav_msgs/msg/Odometry') == {
            'header': header(3_000_000_001, frame_id),
            'child_frame_id': child,
            'pose': {'pose': pose(state.tolist()), 'covariance': [0.0] * 36},
            'twist': {'twist': {'linear': linear, 'angular': angular}, 'covariance': [0.0] * 36},
        }


def parameter(name: str, value) -> dict[str, object]:
    """A rcl_interfaces/Parameter; the types are those of rcl_interfaces/ParameterType."""
    content = {
        'type': 0,
        'bool_value': False,
        'integer_value': 0,
        'double_value': 0.0,
        'string_value': '',
        'byte_array_value': [],
        'bool_array_value': [],
        'integer_array_value': [],
        'double_array_value': [],
        'string_array_value': [],
    }
    if isinstance(value, bool):
        content.update(type=1, bool_value=value)
    elif isinstance(value, int):
        content.update(type=2, integer_value=value)
    elif isinstance(value, float):
        content.update(type=3, double_value=value)
    elif isinstance(value, str):
        content.update(type=4, string_value=value)
    else:
        content.update(type=8, double_array_value=list(value))
    return {'name': name, 'value': content}


VALUES = {
    'yes': True,
    'no': False,
    'count': -(2**62) - 3,
    'gravity': 9.81,
    'nothing': 0.0,
    'physics_model': 'impulse',
    'empty': '',
    'direction': (0.0, 0.6, -0.8),
    'list': [1.5],
    'none': [],
}


@pytest.mark.parametrize('node', ['', '/cube_sim', '/a/cube_sim'])
@pytest.mark.parametrize('new_count', range(len(VALUES) + 1))
def test_a_parameter_event_reads_as_it_was_written_with_every_kind_of_value(node, new_count):
    names = list(VALUES)
    new = {name: VALUES[name] for name in names[:new_count]}
    changed = {name: VALUES[name] for name in names[new_count:]}
    data = events.parameter_event(4_000_000_002, node, new, changed)
    assert read_by_both(data, 'rcl_interfaces/msg/ParameterEvent') == {
        'stamp': stamp(4_000_000_002),
        'node': node,
        'new_parameters': [parameter(*item) for item in new.items()],
        'changed_parameters': [parameter(*item) for item in changed.items()],
        'deleted_parameters': [],
    }


NAMES = st.text('abcdefgé_', max_size=9)
ANY_VALUE = (
    st.booleans()
    | st.integers(-(2**63), 2**63 - 1)
    | st.floats(allow_nan=False)
    | NAMES
    | st.lists(st.floats(allow_nan=False), max_size=4)
)


@given(st.dictionaries(NAMES, ANY_VALUE, max_size=4), st.dictionaries(NAMES, ANY_VALUE, max_size=4))
@hypothesis_settings(deadline=None, derandomize=True, max_examples=150)
def test_any_parameter_event_reads_as_it_was_written(new, changed):
    data = events.parameter_event(0, '/n', new, changed)
    content = read_by_both(data, 'rcl_interfaces/msg/ParameterEvent')
    assert content['new_parameters'] == [parameter(*item) for item in new.items()]
    assert content['changed_parameters'] == [parameter(*item) for item in changed.items()]


def cube(index: int, frame_id: str, time_ns: int, row, action: int, size: float):
    red, green, blue, alpha = markers.PALETTE[index % len(markers.PALETTE)].tolist()
    return {
        'header': header(time_ns, frame_id),
        'ns': 'cubes',
        'id': index,
        'type': 1,
        'action': action,
        'pose': pose(row),
        'scale': {'x': size, 'y': size, 'z': size},
        'color': {'r': red, 'g': green, 'b': blue, 'a': alpha},
        **PLAIN_MARKER,
    }


PLAIN_MARKER = {
    'lifetime': {'sec': 0, 'nanosec': 0},
    'frame_locked': False,
    'points': [],
    'colors': [],
    'texture_resource': '',
    'texture': {'header': header(0, ''), 'format': '', 'data': []},
    'uv_coordinates': [],
    'text': '',
    'mesh_resource': '',
    'mesh_file': {'filename': '', 'data': []},
    'mesh_use_embedded_materials': False,
}


@pytest.mark.parametrize('shown', [0, 1, 2, 3, 20])
@pytest.mark.parametrize('removed', [0, 1, 2, 5])
def test_cube_markers_read_as_they_were_written(shown, removed):
    # One CUBE (type 1) to ADD (action 0) for each pose, then a DELETE (action 2) for each id gone.
    for frame_id in FRAMES:
        values = rows(shown, seed=shown)
        time_ns = 5_000_000_004
        data = markers.cube_markers(time_ns, frame_id, values, 0.75, removed)
        content = read_by_both(data, 'visualization_msgs/msg/MarkerArray')
        expected = [
            cube(index, frame_id, time_ns, row, 0, 0.75)
            for index, row in enumerate(values.tolist())
        ]
        expected += [
            cube(shown + index, frame_id, time_ns, [0.0] * 7, 2, 0.75) for index in range(removed)
        ]
        assert content == {'markers': expected}


def test_cube_markers_do_not_remember_those_before():
    # What does not move is kept between calls: it must be that of the call, and stay clean.
    calls = [
        (1, 'world', 3, 0.5, 0),
        (2, 'world', 3, 0.5, 0),
        (3, 'world', 3, 0.25, 0),
        (4, 'map', 3, 0.5, 0),
        (5, 'world', 1, 0.5, 2),
        (6, 'world', 0, 0.5, 3),
        (7, 'world', 3, 0.5, 0),
        (1, 'world', 3, 0.5, 0),
    ]
    again = {}
    for time_ns, frame_id, shown, size, removed in calls:
        values = rows(shown, seed=time_ns)
        data = markers.cube_markers(time_ns, frame_id, values, size, removed)
        assert again.setdefault(time_ns, data) == data
        content = read_by_both(data, 'visualization_msgs/msg/MarkerArray')['markers']
        assert [marker['header'] for marker in content] == [header(time_ns, frame_id)] * len(
            content
        )
        assert [marker['pose'] for marker in content[:shown]] == [pose(v) for v in values.tolist()]
        assert [marker['action'] for marker in content] == [0] * shown + [2] * removed
        assert {marker['scale']['x'] for marker in content} <= {size}


def test_neighbours_differ_in_colour():
    assert len(np.unique(markers.PALETTE, axis=0)) == len(markers.PALETTE) >= 2
    assert (markers.PALETTE[:, 3] == 1.0).all()


@pytest.mark.parametrize('triangles', [0, 1, 7])
@pytest.mark.parametrize('namespace', ['', 'ground', 'ground_'])
def test_a_triangle_list_reads_as_it_was_written(triangles, namespace):
    for frame_id in FRAMES:
        draw = Draw(9)
        points = np.array([draw.vector(-9.0, 9.0) for _ in range(3 * triangles)]).reshape(-1, 3)
        colors = np.array([draw.vector(0.0, 1.0, 4) for _ in range(3 * triangles)]).reshape(-1, 4)
        data = markers.triangle_list(6_000_000_005, frame_id, namespace, points, colors)
        content = read_by_both(data, 'visualization_msgs/msg/Marker')
        # Colours are float32 in the message.
        single = colors.astype(np.float32).tolist()
        assert content == {
            'header': header(6_000_000_005, frame_id),
            'ns': namespace,
            'id': 0,
            'type': 11,
            'action': 0,
            'pose': pose([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0]),
            'scale': {'x': 1.0, 'y': 1.0, 'z': 1.0},
            'color': {'r': 1.0, 'g': 1.0, 'b': 1.0, 'a': 1.0},
            **PLAIN_MARKER,
            'points': [dict(zip('xyz', point, strict=True)) for point in points.tolist()],
            'colors': [dict(zip('rgba', color, strict=True)) for color in single],
        }


def test_a_message_begins_with_the_encapsulation_of_little_endian_cdr():
    # The two bytes 0x00 0x01 of plain CDR in little-endian order, then no options.
    for data in (
        events.clock(1),
        poses.pose_array(1, 'world', rows(1)),
        markers.cube_markers(1, 'world', rows(1), 0.5),
        markers.cube_markers(1, 'world', rows(0), 0.5),
    ):
        assert data[:4] == b'\x00\x01\x00\x00'


def test_padding_counts_from_the_end_of_the_encapsulation_and_is_zero():
    cdr = CdrWriter()
    cdr.uint8(255)
    cdr.float64s(1.0)
    cdr.uint8(255)
    cdr.int32(-1)
    cdr.uint8(255)
    cdr.int64(-1)
    assert cdr.message() == b''.join(
        (
            b'\x00\x01\x00\x00',
            b'\xff' + bytes(7) + struct.pack('<d', 1.0),
            b'\xff' + bytes(3) + b'\xff' * 4,
            b'\xff' + bytes(7) + b'\xff' * 8,
        )
    )
    assert len(cdr) == len(cdr.message())
