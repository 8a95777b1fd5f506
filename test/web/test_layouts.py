"""The layouts for RViz and Foxglove name what the node has, as it has it."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
import yaml

from cube_sim.node.topics import PUBLISHED, SUBSCRIBED

ROOT = Path(__file__).parents[2]
TOPICS = {spec.name.replace('~', '/cube_sim'): spec for spec in (*PUBLISHED, *SUBSCRIBED)}
SERVICES = {f'/cube_sim/{name}' for name in ('throw', 'reset', 'pause', 'step', 'record')}

# What each display of RViz and each panel of Foxglove takes.
DISPLAYS = {
    'Marker': 'visualization_msgs/msg/Marker',
    'MarkerArray': 'visualization_msgs/msg/MarkerArray',
    'PoseArray': 'geometry_msgs/msg/PoseArray',
    'Pose': 'geometry_msgs/msg/PoseStamped',
    'Odometry': 'nav_msgs/msg/Odometry',
}
SHOWN = {f'/cube_sim/{name}' for name in ('poses', 'markers', 'contacts', 'ground', 'camera/pose')}


@pytest.fixture(scope='module')
def rviz():
    return yaml.safe_load((ROOT / 'rviz/cube_sim.rviz').read_text())['Visualization Manager']


@pytest.fixture(scope='module')
def foxglove():
    return json.loads((ROOT / 'foxglove/cube_sim.json').read_text())


def test_rviz_shows_each_topic_with_its_type_and_delivery(rviz):
    shown = set()
    for display in rviz['Displays']:
        topic = display['Topic']
        spec = TOPICS[topic['Value']]
        assert DISPLAYS[display['Class'].split('/')[1]] == spec.type_name
        durability = 'Transient Local' if spec.latched else 'Volatile'
        assert topic['Durability Policy'] == durability
        assert topic['Reliability Policy'] == 'Reliable'
        assert display['Enabled'] == display['Value']
        shown |= {topic['Value']} if display['Enabled'] else set()
    assert shown == SHOWN
    assert rviz['Global Options']['Fixed Frame'] == 'world'


def test_foxglove_shows_the_same(foxglove):
    scene = foxglove['configById']['3D!scene']
    shown = {name for name, topic in scene['topics'].items() if topic['visible']}
    assert shown == SHOWN
    assert scene['fixedFrame'] == scene['followTf'] == 'world'


def test_foxglove_names_only_what_the_node_has(foxglove):
    named = re.findall(r'"(/[a-z_/]+)', json.dumps(foxglove))
    assert set(named) <= set(TOPICS) | SERVICES
    panels = foxglove['configById']
    assert TOPICS[panels['Teleop!camera']['topic']].type_name == 'geometry_msgs/msg/Twist'
    placed = TOPICS[panels['3D!scene']['publish']['poseTopic']]
    assert placed.type_name == 'geometry_msgs/msg/PoseStamped'


def test_every_panel_of_foxglove_has_its_place(foxglove):
    def panels(node):
        if isinstance(node, str):
            return [node]
        assert node['direction'] in ('row', 'column')
        return panels(node['first']) + panels(node['second'])

    assert sorted(panels(foxglove['layout'])) == sorted(foxglove['configById'])
