from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml

from cube_sim.recording import RecordingError, Topic

INFINITE = {'sec': 9223372036, 'nsec': 854775807}


def test_quality_of_service_is_worded_as_rosbag2_version_9_does():
    topic = Topic('/a', 'std_msgs/msg/Header', 'best_effort', 'transient_local', 7)
    assert topic.qos_profiles() == [
        {
            'history': 'keep_last',
            'depth': 7,
            'reliability': 'best_effort',
            'durability': 'transient_local',
            'deadline': INFINITE,
            'lifespan': INFINITE,
            'liveliness': 'automatic',
            'liveliness_lease_duration': INFINITE,
            'avoid_ros_namespace_conventions': False,
        }
    ]


def test_quality_of_service_as_yaml_is_a_plain_list_of_the_same():
    topic = Topic('/a', 'std_msgs/msg/Header')
    assert yaml.safe_load(topic.qos_yaml()) == topic.qos_profiles()
    assert topic.qos_yaml().startswith('- history: keep_last\n  depth: 10\n')
    assert '&' not in topic.qos_yaml()


@pytest.mark.parametrize(
    ('field', 'value'),
    [
        ('name', 'poses'),
        ('name', '/cube_sim/'),
        ('name', '/2d'),
        ('type', 'geometry_msgs/PoseArray'),
        ('type', 'geometry_msgs/msg/../PoseArray'),
        ('reliability', 'RELIABLE'),
        ('durability', 'reliable'),
        ('depth', 0),
    ],
)
def test_a_topic_that_cannot_be_is_refused_with_its_value(field: str, value: Any):
    right: dict[str, Any] = {'name': '/poses', 'type': 'geometry_msgs/msg/PoseArray'}
    with pytest.raises(RecordingError) as caught:
        Topic(**{**right, field: value})
    assert str(value) in str(caught.value)


def test_the_room_imports_no_ros_and_no_numpy():
    import subprocess
    import sys

    import cube_sim

    code = (
        'import sys, cube_sim.recording\n'
        "heavy = {'rclpy', 'numpy', 'numba', 'geometry_msgs', 'rosbags'} & set(sys.modules)\n"
        'sys.exit(str(heavy) if heavy else 0)'
    )
    root = Path(cube_sim.__file__).parents[1]
    done = subprocess.run(
        [sys.executable, '-c', code], cwd=root, capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, done.stderr) == (0, '')
