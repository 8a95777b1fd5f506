"""Throws: the service, the exact state on ~/throws, and the cubes on ~/poses and ~/markers."""

from __future__ import annotations

import numpy as np
import pytest
from node.ros_values import PERIOD, STEP, free_flight, ns, pose7, settings_of, xyz, xyzw
from visualization_msgs.msg import Marker

from cube_sim.messages.markers import PALETTE
from cube_sim.physics.models import MODELS

YAWED = [0.0, 0.0, np.sqrt(0.5), np.sqrt(0.5)]


def test_a_throw_answers_the_index_and_tells_the_exact_state(ros, sim):
    sim(start_paused=True, throw_speed=6.0, throw_spin=[0.5, -1.0, 2.0])
    throws = ros.listen('throws')
    assert [ros.do('throw') for _ in range(3)] == ['0', '1', '2']
    messages = throws.wait_for_count(3)
    assert [message.child_frame_id for message in messages] == ['cube_0', 'cube_1', 'cube_2']
    first = messages[0]
    assert first.header.frame_id == 'world'
    assert ns(first) == 0
    assert pose7(first.pose.pose).tolist() == [0, 0, 1.5, 0, 0, 0, 1]
    assert xyz(first.twist.twist.linear).tolist() == [6, 0, 0]
    assert xyz(first.twist.twist.angular).tolist() == [0.5, -1, 2]
    assert not first.pose.covariance.any()
    assert not first.twist.covariance.any()


def test_the_poses_hold_every_cube_in_throw_order(ros, sim):
    sim({'camera.position': [1.0, 2.0, 5.0]}, start_paused=True)
    poses = ros.listen('poses')
    for count in range(3):
        ros.do('step')
        assert len(poses.wait_for_count(count + 1)[count].poses) == count
        ros.do('throw')
    ros.do('step')
    last = poses.wait_for_count(4)[3]
    assert last.header.frame_id == 'world'
    x = [pose.position.x for pose in last.poses]
    assert len(x) == 3
    assert x[0] > x[1] > x[2] > 1.0


def test_a_cube_in_flight_follows_the_closed_form(ros, sim):
    sim({'camera.position': [0.0, 0.0, 30.0]}, start_paused=True)
    poses = ros.listen('poses')
    ros.do('step')
    ros.do('throw')
    for _ in range(20):
        ros.do('step')
    start, velocity = np.array([0.0, 0.0, 30.0]), np.array([8.0, 0.0, 0.0])
    for message in poses.wait_for_count(21)[1:]:
        seconds = (ns(message) - PERIOD) * 1e-9
        expected = free_flight(start, velocity, seconds, STEP * 1e-9)
        assert xyz(message.poses[0].position) == pytest.approx(expected, abs=1e-11)
        turn = xyzw(message.poses[0].orientation)
        # The spin is constant, so the axis stays; 2 acos(w) is how far it has turned.
        spin = np.array([1.0, 2.0, 3.0])
        angle = np.linalg.norm(spin) * seconds
        half = np.append(spin / np.linalg.norm(spin) * np.sin(angle / 2), np.cos(angle / 2))
        assert turn == pytest.approx(half, abs=1e-11)


def test_poses_are_stamped_with_simulation_time_one_period_after_another(ros, sim):
    sim(publish_rate=100.0, real_time_factor=0.0)
    poses = ros.listen('poses')
    stamps = [ns(message) for message in poses.wait_for_count(20)]
    assert all(stamp > 0 and stamp % 10_000_000 == 0 for stamp in stamps)
    assert stamps == sorted(set(stamps))


def test_poses_of_a_run_at_pace_miss_none(ros, sim):
    sim()
    poses = ros.listen('poses')
    stamps = np.array([ns(message) for message in poses.wait_for_count(20)])
    assert set(np.diff(stamps)) == {PERIOD}


def test_each_cube_is_a_marker_with_the_index_as_its_id(ros, sim):
    sim(start_paused=True, cube_size=0.3)
    markers, poses = ros.listen('markers'), ros.listen('poses')
    for _ in range(3):
        ros.do('throw')
    ros.do('step')
    cubes, places = markers.wait_for().markers, poses.wait_for().poses
    assert [cube.id for cube in cubes] == [0, 1, 2]
    assert len({cube.ns for cube in cubes}) == 1
    for cube, place, color in zip(cubes, places, PALETTE, strict=False):
        assert (cube.type, cube.action) == (Marker.CUBE, Marker.ADD)
        assert (cube.header.frame_id, ns(cube)) == ('world', PERIOD)
        assert xyz(cube.scale).tolist() == [0.3, 0.3, 0.3]
        assert pose7(cube.pose).tolist() == pose7(place).tolist()
        shown = [cube.color.r, cube.color.g, cube.color.b, cube.color.a]
        assert shown == pytest.approx(color)
        assert cube.color.a == 1.0


def test_everything_is_in_the_frame_that_was_asked_for(ros, sim):
    sim(start_paused=True, frame_id='plane')
    topics = ('poses', 'markers', 'ground', 'throws', 'camera/pose', 'resets')
    poses, markers, ground, throws, camera, resets = (ros.listen(topic) for topic in topics)
    ros.do('throw')
    ros.do('step')
    assert markers.wait_for().markers[0].header.frame_id == 'plane'
    ros.do('reset')
    assert resets.wait_for().frame_id == 'plane'
    for listener in (poses, ground, throws, camera):
        assert listener.wait_for().header.frame_id == 'plane'


def test_a_throw_goes_along_the_x_axis_of_the_camera_as_world_velocity(ros, sim):
    place = {'camera.position': [3.0, -1.0, 20.0], 'camera.orientation': YAWED}
    sim(place, start_paused=True)
    throws, poses = ros.listen('throws'), ros.listen('poses')
    ros.do('throw')
    twist = throws.wait_for().twist.twist
    assert xyz(twist.linear).tolist() == [8, 0, 0], 'in the child frame: the axes of the camera'
    assert xyz(twist.angular).tolist() == [1, 2, 3]
    ros.do('step')
    cube = poses.wait_for().poses[0]
    expected = free_flight(np.array([3.0, -1.0, 20.0]), np.array([0.0, 8.0, 0.0]), 0.02, 0.002)
    assert xyz(cube.position) == pytest.approx(expected, abs=1e-12)
    # Turned in its own axes: q0 times the turn of (1, 2, 3) rad/s for 0.02 s.
    spin = np.array([1.0, 2.0, 3.0])
    half = 0.5 * np.linalg.norm(spin) * 0.02
    turn = np.append(spin / np.linalg.norm(spin) * np.sin(half), np.cos(half))
    x, y, z, w = turn
    s = np.sqrt(0.5)
    expected = s * np.array([x - y, x + y, z + w, w - z])
    assert xyzw(cube.orientation) == pytest.approx(expected, abs=1e-12)


def test_throws_beyond_max_cubes_are_refused_until_a_reset(ros, sim):
    sim(start_paused=True, max_cubes=2)
    throws = ros.listen('throws')
    assert [ros.do('throw'), ros.do('throw')] == ['0', '1']
    reason = ros.refuse('throw')
    assert 'There are 2 cubes already' in reason
    assert 'reset' in reason
    assert 'max_cubes' in reason
    ros.do('reset')
    assert ros.do('throw') == '0'
    assert [message.child_frame_id for message in throws.wait_for_count(3)] == [
        'cube_0',
        'cube_1',
        'cube_0',
    ]


def test_a_higher_max_cubes_lets_throws_go_on(ros, sim):
    sim(start_paused=True, max_cubes=1)
    ros.do('throw')
    ros.refuse('throw')
    assert ros.set('max_cubes', 2).successful
    assert ros.do('throw') == '1'


def test_a_throw_takes_the_speed_and_spin_of_the_moment(ros, sim):
    sim(start_paused=True)
    throws = ros.listen('throws')
    assert ros.set('throw_speed', -2.5).successful
    assert ros.set('throw_spin', [0.0, 0.0, 7.0]).successful
    ros.do('throw')
    twist = throws.wait_for().twist.twist
    assert xyz(twist.linear).tolist() == [-2.5, 0, 0]
    assert xyz(twist.angular).tolist() == [0, 0, 7]


def test_a_scenario_plays_its_entries_at_their_times(ros, sim, tmp_path):
    file = tmp_path / 'scenario.yaml'
    file.write_text(
        '- {at: 0.0, camera: {position: [0, 0, 9], orientation: [0, 0, 0, 2]}}\n'
        '- {at: 0.0, throw: {}}\n'
        '- {at: 0.05, throw: {speed: 6.0, spin: [3, 2, 1]}}\n'
        '- {at: 0.0501, set: {restitution: 0.8, throw_speed: 4}}\n'
        '- {at: 0.06, throw: {}}\n'
        '- {at: 0.1, reset: {}}\n'
    )
    sim(start_paused=True, scenario=str(file))
    throws, poses, settings, resets = (
        ros.listen(topic) for topic in ('throws', 'poses', 'settings', 'resets')
    )
    for _ in range(7):
        ros.do('step')
    counts = [len(message.poses) for message in poses.wait_for_count(7)]
    # What is due at the time of a publication comes after it: it is stamped for the next step.
    assert counts == [1, 1, 2, 3, 3, 0, 0]
    thrown = throws.wait_for_count(3)
    assert [ns(message) for message in thrown] == [0, 50_000_000, 60_000_000]
    assert [message.twist.twist.linear.x for message in thrown] == [8.0, 6.0, 4.0]
    assert xyz(thrown[1].twist.twist.angular).tolist() == [3, 2, 1]
    assert pose7(thrown[0].pose.pose).tolist() == [0, 0, 9, 0, 0, 0, 1]
    changed = settings.wait_for_count(2)[1]
    # 0.0501 s is no multiple of the step: it takes effect before the first step after it.
    assert ns(changed.stamp) == 52_000_000
    assert settings_of(changed)['restitution'] == 0.8
    assert ns(resets.wait_for().stamp) == 100_000_000
    assert ros.get('restitution', 'throw_speed') == [0.8, 4.0]


def test_next_model_goes_through_all_models_and_shows_everywhere(ros, sim):
    sim(start_paused=True)
    settings = ros.listen('settings')
    names = list(MODELS)
    for turn, name in enumerate([*names[1:], names[0]]):
        assert ros.do('next_model') == name
        assert ros.get('physics_model') == [name]
        assert settings_of(settings.wait_for_count(turn + 2)[-1])['physics_model'] == name


def test_the_model_can_be_switched_while_cubes_are_in_flight(ros, sim):
    simulator = sim({'camera.position': [0.0, 0.0, 0.6]}, start_paused=True)
    settings, poses = ros.listen('settings'), ros.listen('poses')
    ros.do('throw')
    for _ in range(3):
        ros.do('step')
    assert simulator.simulation.world.contacts == 0, 'still in flight'
    ros.do('next_model')
    for _ in range(20):
        ros.do('step')
    switch = settings.wait_for_count(2)[1]
    assert ns(switch.stamp) == 3 * PERIOD
    assert settings_of(switch)['physics_model'] == 'impulse'
    assert simulator.simulation.world.contacts > 0
    # An impulse off the centre has changed the spin, as the model before it never does.
    assert not np.allclose(simulator.simulation.world.velocities[0, 3:], [1, 2, 3])
    assert len(poses.wait_for_count(23)[-1].poses) == 1
