"""Topics: types and delivery, what a late joiner gets, and nothing built for nobody."""

from __future__ import annotations

import numpy as np
import pytest
from node.ros_contract import LATCHED, PUBLISHED, SUBSCRIBED
from node.ros_values import ns, pose7, settings_of, xyz
from visualization_msgs.msg import Marker

from cube_sim.messages import events, markers, poses


@pytest.mark.parametrize('name', PUBLISHED)
def test_a_topic_is_published_as_the_contract_says(ros, sim, name):
    simulator = sim()
    channel = PUBLISHED[name]
    (found,) = ros.node.get_publishers_info_by_topic(name)
    assert found.node_name == 'cube_sim'
    assert found.topic_type == channel.type_name
    assert found.qos_profile.reliability == channel.reliability
    assert found.qos_profile.durability == channel.durability
    # Discovery does not tell the depth, so it is asked for where it is kept.
    (publisher,) = (p for p in simulator.publishers if p.topic_name == name)
    depth = publisher.qos_profile.depth
    assert depth >= 1000 if channel.depth == 1000 else depth == channel.depth


@pytest.mark.parametrize('name', SUBSCRIBED)
def test_a_topic_is_subscribed_to_as_the_contract_says(ros, sim, name):
    sim()
    (found,) = ros.node.get_subscriptions_info_by_topic(name)
    assert found.topic_type == SUBSCRIBED[name].type_name


def test_whoever_comes_late_gets_all_that_is_latched(ros, sim):
    sim(start_paused=True)
    for _ in range(3):
        ros.do('throw')
        ros.do('step')
    assert ros.set('restitution', 0.25).successful
    ros.do('reset')
    ros.do('throw')
    late = {name: ros.listen(name) for name in LATCHED}
    thrown = late['/cube_sim/throws'].wait_for_count(4)
    assert [message.child_frame_id for message in thrown] == [
        'cube_0',
        'cube_1',
        'cube_2',
        'cube_0',
    ]
    settings = late['/cube_sim/settings'].wait_for_count(2)
    assert [settings_of(message)['restitution'] for message in settings] == [0.5, 0.25]
    assert ns(late['/cube_sim/resets'].wait_for().stamp) == 60_000_000
    assert pose7(late['/cube_sim/camera/pose'].wait_for().pose).tolist() == [0, 0, 1.5, 0, 0, 0, 1]
    late['/cube_sim/ground'].wait_for()


def test_whoever_comes_late_gets_a_thousand_throws(ros, sim, tmp_path):
    file = tmp_path / 'scenario.yaml'
    file.write_text('- {at: 0, throw: {}}\n' * 1000)
    simulator = sim(scenario=str(file), start_paused=True)
    ros.do('step')
    assert len(simulator.simulation.world) == 1000
    thrown = ros.listen('throws').wait_for_count(1000)
    assert [message.child_frame_id for message in thrown] == [f'cube_{n}' for n in range(1000)]


def test_the_ground_is_triangles_in_colour_none_below_the_plane(ros, sim):
    sim()
    ground = ros.listen('ground').wait_for()
    assert ground.type == Marker.TRIANGLE_LIST
    assert ground.header.frame_id == 'world'
    assert xyz(ground.scale).tolist() == [1, 1, 1]
    assert pose7(ground.pose).tolist() == [0, 0, 0, 0, 0, 0, 1]
    points = np.array([xyz(point) for point in ground.points])
    assert len(points) == len(ground.colors)
    assert len(points) % 3 == 0
    assert len(points) >= 300
    assert np.all(points[:, 2] >= 0)
    assert np.any(points[:, 2] > 1), 'hills'
    near = np.hypot(points[:, 0], points[:, 1]) < 10
    assert np.all(points[near, 2] == 0), 'flat where the cubes are'
    colors = np.array([[color.r, color.g, color.b, color.a] for color in ground.colors])
    assert np.all((colors >= 0) & (colors <= 1))
    assert np.all(colors[:, 3] == 1)
    assert len(np.unique(colors, axis=0)) > 2
    a, b, c = points[0::3], points[1::3], points[2::3]
    assert np.all(np.cross(b - a, c - a)[:, 2] > 0), 'every triangle is seen from above'


LAYOUTS = {
    'poses': (poses, 'pose_array'),
    'markers': (markers, 'cube_markers'),
    '/clock': (events, 'clock'),
    'contacts': (markers, 'contact_lines'),
}


@pytest.fixture
def built(monkeypatch):
    """How often the message of each topic has been laid out."""
    counts = dict.fromkeys(LAYOUTS, 0)

    def counted(topic, layout):
        def lay_out(*args, **kwargs):
            counts[topic] += 1
            return layout(*args, **kwargs)

        return lay_out

    for topic, (module, name) in LAYOUTS.items():
        monkeypatch.setattr(module, name, counted(topic, getattr(module, name)))
    return counts


def test_messages_for_nobody_are_not_built(ros, sim, built):
    sim(start_paused=True)
    ros.do('throw')
    for _ in range(5):
        ros.do('step')
    assert built == dict.fromkeys(LAYOUTS, 0)


@pytest.mark.parametrize('topic', LAYOUTS)
def test_messages_are_built_for_whoever_listens_and_no_others(ros, sim, built, topic):
    sim(start_paused=True)
    ros.do('step')
    listener = ros.listen(topic)
    ros.do('throw')
    for count in range(1, 4):
        ros.do('step')
        listener.wait_for_count(count)
    assert built == {**dict.fromkeys(LAYOUTS, 0), topic: 3}


def test_messages_are_built_once_for_two_who_listen(ros, sim, built):
    sim(start_paused=True)
    first, second = ros.listen('poses', raw=True), ros.listen('poses', raw=True)
    ros.do('throw')
    ros.do('step')
    assert first.wait_for() == second.wait_for()
    assert built['poses'] == 1


def test_messages_are_built_for_a_recording_the_markers_on_wish(ros, sim, built):
    sim(start_paused=True, record=True)
    ros.do('throw')
    ros.do('step')
    assert built == {'poses': 1, 'markers': 0, '/clock': 1, 'contacts': 0}
    assert ros.set('record_markers', True).successful
    ros.do('step')
    assert built == {'poses': 2, 'markers': 1, '/clock': 2, 'contacts': 0}
    ros.do('record', False)
    ros.do('step')
    assert built == {'poses': 2, 'markers': 1, '/clock': 2, 'contacts': 0}


def test_a_namespace_and_a_name_move_everything_that_is_private(ros, sim, tmp_path):
    sim(start_paused=True, record=True, options={'namespace': '/left'})
    names = {name for name, _ in ros.node.get_topic_names_and_types()}
    moved = {f'/left{name}' for name in (*PUBLISHED, *SUBSCRIBED) if name.startswith('/cube_sim')}
    assert moved <= names
    assert '/clock' in names
    assert not any(name.startswith('/cube_sim') for name in names)
