from __future__ import annotations

import json
from pathlib import Path

import pytest
from mcap_ros2._dynamic import generate_dynamic
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from cube_sim.recording import RecordingError
from cube_sim.recording.definitions import find_definition

SEPARATOR = '=' * 80
RECORDED = [
    'geometry_msgs/msg/PoseArray',
    'geometry_msgs/msg/PoseStamped',
    'visualization_msgs/msg/MarkerArray',
    'visualization_msgs/msg/Marker',
    'nav_msgs/msg/Odometry',
    'rcl_interfaces/msg/ParameterEvent',
    'std_msgs/msg/Header',
    'rosgraph_msgs/msg/Clock',
    'diagnostic_msgs/msg/DiagnosticArray',
]


def sections(text: str) -> list[tuple[str, str]]:
    """Split a schema into (name, text), the root's name empty."""
    root, *rest = text.split(f'\n{SEPARATOR}\n')
    return [('', root), *(tuple(part.removeprefix('MSG: ').split('\n', 1)) for part in rest)]


@pytest.fixture
def prefix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A ROS prefix with the package bricks_msgs, in AMENT_PREFIX_PATH behind an empty one."""
    (tmp_path / 'empty').mkdir()
    folder = tmp_path / 'full' / 'share' / 'bricks_msgs' / 'msg'
    folder.mkdir(parents=True)
    (folder / 'Wall.msg').write_text(
        '# Brick in a comment is no field: Brick hidden\n'
        'string COLOR="red # Brick"\n'
        'uint8 LOW=1\n'
        'Row[] rows\n'
        'string<=5[<=3] names\n'
        'float64[3] size [1.0, 2.0, 3.0]\n'
        'bricks_msgs/Brick[<=4] spare  # Mortar\n'
        '  bricks_msgs/msg/Mortar mortar'
    )
    (folder / 'Row.msg').write_text('Brick brick\nBrick[2] others\n')
    (folder / 'Brick.msg').write_text('Mortar mortar\nint32 weight -1\n')
    (folder / 'Mortar.msg').write_text('float32 strength\n')
    (folder / 'Wall.json').write_text(
        json.dumps({'type_hashes': [{'type_name': 'bricks_msgs/msg/Wall', 'hash_string': 'H'}]})
    )
    monkeypatch.setenv('AMENT_PREFIX_PATH', f'{tmp_path}/empty::{tmp_path}/full')
    return tmp_path / 'full'


@pytest.mark.parametrize('name', RECORDED)
def test_every_recorded_type_parses_with_both_readers(name: str):
    text = find_definition(name).text
    assert name in get_types_from_msg(text, name)
    assert name in generate_dynamic(name, text)


@pytest.mark.parametrize('name', RECORDED)
def test_the_type_hash_is_the_one_computed_from_the_definition(name: str):
    expected = get_typestore(Stores.ROS2_JAZZY).hash_rihs01(name)
    assert find_definition(name).type_hash == expected


def test_a_pose_array_is_followed_by_its_parts_depth_first():
    names = [name for name, _ in sections(find_definition('geometry_msgs/msg/PoseArray').text)]
    assert names == [
        '',
        'std_msgs/Header',
        'builtin_interfaces/Time',
        'geometry_msgs/Pose',
        'geometry_msgs/Point',
        'geometry_msgs/Quaternion',
    ]


def test_each_part_is_there_once_with_the_text_of_its_file(prefix: Path):
    folder = prefix / 'share' / 'bricks_msgs' / 'msg'
    found = find_definition('bricks_msgs/msg/Wall')
    assert sections(found.text) == [
        ('', (folder / 'Wall.msg').read_text()),
        ('bricks_msgs/Row', (folder / 'Row.msg').read_text()),
        ('bricks_msgs/Brick', (folder / 'Brick.msg').read_text()),
        ('bricks_msgs/Mortar', (folder / 'Mortar.msg').read_text()),
    ]
    assert found.type_hash == 'H'


def test_types_outside_of_the_listed_prefixes_are_found_beside_their_python_package(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    site = tmp_path / 'lib' / 'python3' / 'site-packages'
    (site / 'lone_msgs').mkdir(parents=True)
    (site / 'lone_msgs' / '__init__.py').write_text('raise RuntimeError("was imported")')
    folder = tmp_path / 'share' / 'lone_msgs' / 'msg'
    folder.mkdir(parents=True)
    (folder / 'One.msg').write_text('int8 value\n')
    (folder / 'One.json').write_text(
        '{"type_hashes": [{"type_name": "lone_msgs/msg/One", "hash_string": "H1"}]}'
    )
    monkeypatch.syspath_prepend(str(site))
    assert find_definition('lone_msgs/msg/One').text == 'int8 value\n'


def test_a_definition_is_read_from_disk_only_once(prefix: Path):
    first = find_definition('bricks_msgs/msg/Wall')
    (prefix / 'share' / 'bricks_msgs' / 'msg' / 'Wall.msg').unlink()
    assert find_definition('bricks_msgs/msg/Wall') is first


def test_a_missing_part_names_the_package_to_install(prefix: Path):
    (prefix / 'share' / 'bricks_msgs' / 'msg' / 'Row.msg').write_text('glue_msgs/Glue glue\n')
    with pytest.raises(RecordingError, match=r'ros-jazzy-glue-msgs') as caught:
        find_definition('bricks_msgs/msg/Wall')
    assert 'share/glue_msgs/msg/Glue.msg' in str(caught.value)


@pytest.mark.parametrize('text', ['', '[]', '{"type_hashes": []}', '{"type_hashes": [{}]}'])
def test_a_damaged_description_is_one_clear_error(prefix: Path, text: str):
    (prefix / 'share' / 'bricks_msgs' / 'msg' / 'Wall.json').write_text(text)
    with pytest.raises(RecordingError, match='reinstall the ROS package bricks_msgs'):
        find_definition('bricks_msgs/msg/Wall')
