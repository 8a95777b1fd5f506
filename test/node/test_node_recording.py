"""Recording: the bag that the node makes, read with the libraries of others."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from geometry_msgs.msg import PoseStamped
from node.ros_contract import LATCHED, PUBLISHED, SUBSCRIBED
from node.ros_values import PERIOD, ns, settings_of
from rcl_interfaces.msg import Log
from rosbags.highlevel import AnyReader

# What may be recorded: contacts are to look at, and can be computed again.
RECORDED = {n: channel for n, channel in PUBLISHED.items() if n != '/cube_sim/contacts'}
ALL = {**RECORDED, **SUBSCRIBED}


def read(path):
    """(topic, log time, bytes, message) of each message of a bag."""
    with AnyReader([Path(path)]) as reader:
        return [
            (link.topic, time_ns, bytes(data), reader.deserialize(data, link.msgtype))
            for link, time_ns, data in reader.messages()
        ]


def of(messages, topic):
    """(log time, bytes, message) of those of a topic."""
    name = topic if topic.startswith('/') else f'/cube_sim/{topic}'
    return [rest for found, *rest in messages if found == name]


def test_recording_starts_and_stops_and_answers_the_path(ros, sim, tmp_path):
    simulator = sim()
    path = ros.do('record', True)
    assert Path(path).parent == tmp_path / 'bags'
    assert str(simulator.bag_path) == path
    assert 'Already recording' in ros.refuse('record', True)
    assert path in ros.refuse('record', True)
    assert ros.do('record', False) == path
    assert simulator.bag_path is None
    assert (Path(path) / 'metadata.yaml').is_file()
    assert (Path(path) / f'{Path(path).name}_0.mcap').is_file()
    assert 'Nothing is being recorded' in ros.refuse('record', False)


def test_a_second_recording_is_another_bag(ros, sim):
    sim(start_paused=True)
    paths = []
    for _ in range(2):
        paths.append(ros.do('record', True))
        ros.do('step')
        ros.do('record', False)
    assert paths[0] != paths[1]
    stamps = [[time_ns for time_ns, _, _ in of(read(path), 'poses')] for path in paths]
    assert stamps == [[PERIOD], [2 * PERIOD]]


def test_the_bag_has_the_topics_and_types_of_the_contract(ros, sim):
    simulator = sim(record=True)
    with AnyReader([simulator.close()]) as reader:
        types = {name: topic.msgtype for name, topic in reader.topics.items()}
    assert types == {name: channel.type_name for name, channel in ALL.items()}


def test_the_bag_holds_the_very_bytes_that_were_published(ros, sim):
    simulator = sim(real_time_factor=0.5, record=True)
    live = {
        name: ros.listen(name, raw=True)
        for name, channel in RECORDED.items()
        if channel.reliable and name not in ('/cube_sim/markers', '/diagnostics')
    }
    for _ in range(5):
        ros.do('throw')
    live['/cube_sim/poses'].next()
    assert ros.set('physics_model', 'impulse').successful
    ros.do('pause', True)
    ros.do('reset')
    ros.do('step')
    ros.do('throw')
    ros.do('step')
    messages = read(simulator.close())
    assert {len(message.poses) for _, _, message in of(messages, 'poses')} >= {0, 1, 5}
    for name, listener in live.items():
        recorded = [data for _, data, _ in of(messages, name)]
        received = listener.wait_for_count(len(recorded) if name in LATCHED else 1)
        # Latched topics are heard from the start, the others from when they were listened to.
        assert received == recorded[len(recorded) - len(received) :], name


def test_log_time_is_simulation_time_and_never_goes_back(ros, sim):
    simulator = sim(start_paused=True, record=True, publish_rate=250.0)
    ros.do('throw')
    for _ in range(5):
        ros.do('step')
    ros.do('throw')
    ros.do('reset')
    ros.do('step')
    messages = read(simulator.close())
    times = [time_ns for _, time_ns, _, _ in messages]
    assert times == sorted(times)
    for topic in ('poses', 'throws', 'camera/pose', 'ground'):
        found = of(messages, topic)
        assert found, topic
        assert all(time_ns == ns(message) for time_ns, _, message in found), topic
    assert [time_ns for time_ns, _, _ in of(messages, 'poses')] == [
        4_000_000 * n for n in range(1, 7)
    ]
    assert [time_ns for time_ns, _, _ in of(messages, 'throws')] == [0, 20_000_000]
    assert [time_ns for time_ns, _, _ in of(messages, 'resets')] == [20_000_000]
    assert [(t, ns(m.clock)) for t, _, m in of(messages, '/clock')] == [
        (4_000_000 * n, 4_000_000 * n) for n in range(1, 7)
    ]


def test_a_recording_from_the_start_begins_with_what_is_latched(ros, sim):
    simulator = sim(start_paused=True, record=True)
    ros.do('step')
    topics = [topic for topic, *_ in read(simulator.close())]
    assert set(topics[:3]) == {
        '/cube_sim/ground',
        '/cube_sim/settings',
        '/cube_sim/camera/pose',
    }
    assert '/cube_sim/poses' in topics[3:]


def test_a_recording_that_starts_in_mid_run_holds_what_went_before(ros, sim):
    simulator = sim(start_paused=True)
    throws = ros.listen('throws', raw=True)
    ros.do('throw')
    ros.do('step')
    assert ros.set('restitution', 0.25).successful
    ros.do('throw')
    ros.do('step')
    ros.do('record', True)
    ros.do('step')
    messages = read(simulator.close())
    before = [topic for topic, *_ in messages].index('/cube_sim/poses')
    latched = [entry for entry in messages[:before] if entry[0] in LATCHED]
    assert {time_ns for _, time_ns, _, _ in latched} == {2 * PERIOD}
    assert [data for _, data, _ in of(latched, 'throws')] == throws.wait_for_count(2)
    assert [ns(message) for _, _, message in of(latched, 'throws')] == [0, PERIOD]
    settings = [message for _, _, message in of(latched, 'settings')]
    assert [ns(message.stamp) for message in settings] == [0, PERIOD]
    values = [
        next(p for p in (*m.new_parameters, *m.changed_parameters) if p.name == 'restitution')
        for m in settings
    ]
    assert [parameter.value.double_value for parameter in values] == [0.5, 0.25]
    assert len(of(latched, 'ground')) == len(of(latched, 'camera/pose')) == 1
    (poses,) = of(messages, 'poses')
    assert len(poses[2].poses) == 2


def test_a_recording_after_a_reset_needs_no_cube_that_is_gone(ros, sim):
    simulator = sim(start_paused=True)
    ros.do('throw')
    assert ros.set('friction', 0.25).successful
    ros.do('reset')
    ros.do('throw')
    ros.do('record', True)
    ros.do('step')
    messages = read(simulator.close())
    assert [message.child_frame_id for _, _, message in of(messages, 'throws')] == ['cube_0']
    assert len(of(messages, 'resets')) == 1
    assert len(of(messages, 'settings')) == 1


@pytest.mark.parametrize('wanted', [False, True])
def test_markers_are_recorded_on_wish_only(ros, sim, wanted):
    simulator = sim(start_paused=True, record=True, record_markers=wanted)
    live = ros.listen('markers', raw=True)
    ros.do('throw')
    ros.do('step')
    sent = live.wait_for()
    recorded = [data for _, data, _ in of(read(simulator.close()), 'markers')]
    assert recorded == ([sent] if wanted else [])


def test_what_the_camera_is_told_is_recorded_too(ros, sim):
    simulator = sim(start_paused=True, record=True)
    camera = ros.listen('camera/pose')
    message = PoseStamped()
    message.pose.position.x = 3.0
    ros.publisher('camera/set_pose').publish(message)
    camera.wait_for(lambda found: found.pose.position.x == 3.0)
    ((_, _, told),) = of(read(simulator.close()), 'camera/set_pose')
    assert told.pose.position.x == 3.0


def test_a_recording_alone_is_reason_enough_to_build_all_poses(ros, sim):
    simulator = sim(start_paused=True, record=True)
    ros.do('throw')
    for _ in range(10):
        ros.do('step')
    found = of(read(simulator.close()), 'poses')
    assert np.array_equal([t for t, _, _ in found], PERIOD * np.arange(1, 11))
    assert all(len(message.poses) == 1 for _, _, message in found)


def test_a_bag_that_cannot_be_made_is_refused_and_the_node_goes_on(ros, sim, tmp_path):
    (tmp_path / 'file').write_text('in the way')
    sim(bag_directory=str(tmp_path / 'file' / 'bags'))
    poses = ros.listen('poses')
    reason = ros.refuse('record', True)
    assert str(tmp_path / 'file') in reason
    assert 'irectory' in reason
    ros.refuse('record', True)
    ros.do('throw')
    poses.wait_for(lambda message: len(message.poses) == 1)


@pytest.mark.parametrize('directory', ['{}/file/bags', '~nobody_of_that_name/bags'])
def test_a_run_that_cannot_be_recorded_says_so_once_and_runs(ros, sim, tmp_path, directory):
    (tmp_path / 'file').write_text('in the way')
    log = ros.listen('/rosout')
    simulator = sim(record=True, bag_directory=directory.format(tmp_path))
    error = log.wait_for(lambda entry: entry.level == Log.ERROR)
    assert 'without a recording' in error.msg
    ros.do('throw')
    assert simulator.bag_path is None
    assert len([entry for entry in log.messages if entry.level >= Log.ERROR]) == 1


def test_settings_that_change_while_recording_are_in_the_bag(ros, sim):
    simulator = sim(start_paused=True, record=True)
    live = ros.listen('settings')
    ros.do('step')
    ros.do('next_model')
    ros.do('step')
    changed = live.wait_for_count(2)[1]
    found = of(read(simulator.close()), 'settings')
    assert [time_ns for time_ns, _, _ in found] == [0, PERIOD]
    recorded = found[1][2].changed_parameters
    assert {p.name for p in recorded} == set(settings_of(changed))
