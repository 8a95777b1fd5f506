"""Time: pause, step, reset, the clock, and the end after a duration."""

from __future__ import annotations

import threading

import numpy as np
from node.ros_session import DEADLINE
from node.ros_values import PERIOD, ns
from visualization_msgs.msg import Marker


def test_paused_time_stands_still(ros, sim):
    sim()
    poses = ros.listen('poses')
    poses.wait_for_count(3)
    answer = ros.do('pause', True)
    assert answer.startswith('paused at ')
    paused = round(float(answer.split()[2]) * 1e3) * 1_000_000
    # What comes while time stands still would come before what a step publishes.
    for count in (1, 2):
        ros.do('step')
        assert ns(poses.wait_for(lambda m: ns(m) > paused)) == paused + PERIOD
        stamps = [ns(message) for message in poses.messages]
        poses.wait_for(lambda m, n=count: ns(m) == paused + n * PERIOD)
        assert stamps[-1] <= paused + count * PERIOD
    assert ros.do('pause', True) == f'paused at {(paused + 2 * PERIOD) * 1e-9:.3f} s'
    assert ros.do('pause', False).startswith('running')
    poses.wait_for(lambda m: ns(m) == paused + 3 * PERIOD)


def test_a_step_advances_one_period_and_publishes_once(ros, sim):
    sim(start_paused=True, publish_rate=25.0)
    poses, markers, clock = ros.listen('poses'), ros.listen('markers'), ros.listen('/clock')
    ros.do('throw')
    answers = []
    for count in range(1, 6):
        answers.append(ros.do('step'))
        assert ns(poses.wait_for_count(count)[-1]) == count * 40_000_000
        markers.wait_for_count(count)
        assert ns(clock.wait_for_count(count)[-1].clock) == count * 40_000_000
    assert answers == ['0.040 s', '0.080 s', '0.120 s', '0.160 s', '0.200 s']
    assert (len(poses.messages), len(markers.messages), len(clock.messages)) == (5, 5, 5)


def test_a_step_of_a_running_simulation_is_refused_with_the_reason(ros, sim):
    sim()
    assert 'pause' in ros.refuse('step')
    ros.do('pause', True)
    ros.do('step')
    ros.do('pause', False)
    assert 'pause' in ros.refuse('step')


def test_a_simulation_that_starts_paused_waits_at_zero(ros, sim):
    simulator = sim(start_paused=True)
    poses = ros.listen('poses')
    ros.do('throw')
    assert simulator.simulation.world.time_ns == 0
    ros.do('pause', False)
    assert ns(poses.wait_for()) == PERIOD


def test_a_reset_removes_all_cubes_and_time_goes_on(ros, sim):
    sim(start_paused=True)
    poses, resets = ros.listen('poses'), ros.listen('resets')
    for _ in range(3):
        ros.do('throw')
    ros.do('step')
    assert ros.do('reset') == '3 cubes removed'
    ros.do('step')
    before, after = poses.wait_for_count(2)
    assert (len(before.poses), len(after.poses)) == (3, 0)
    assert (ns(before), ns(after)) == (PERIOD, 2 * PERIOD)
    header = resets.wait_for()
    assert (ns(header.stamp), header.frame_id) == (PERIOD, 'world')
    assert ros.do('throw') == '0'


def test_a_reset_of_nothing_is_told_too(ros, sim):
    sim()
    resets = ros.listen('resets')
    assert ros.do('reset') == '0 cubes removed'
    ros.do('reset')
    resets.wait_for_count(2)


def test_markers_of_removed_cubes_are_deleted_once(ros, sim):
    sim(start_paused=True)
    markers = ros.listen('markers')
    for _ in range(3):
        ros.do('throw')
    ros.do('step')
    ros.do('reset')
    ros.do('throw')
    ros.do('step')
    ros.do('step')
    actions = [[(m.id, m.action) for m in array.markers] for array in markers.wait_for_count(3)]
    add, delete = Marker.ADD, Marker.DELETE
    assert actions == [
        [(0, add), (1, add), (2, add)],
        [(0, add), (1, delete), (2, delete)],
        [(0, add)],
    ]


def test_the_clock_never_jumps_back(ros, sim):
    sim(real_time_factor=5.0)
    clock = ros.listen('/clock')
    clock.wait_for_count(3)
    ros.do('throw')
    ros.do('pause', True)
    ros.do('step')
    ros.do('reset')
    ros.do('step')
    assert ros.set('publish_rate', 250.0).successful
    ros.do('step')
    ros.do('pause', False)
    clock.next()
    assert ros.set('publish_rate', 10.0).successful
    assert ros.set('real_time_factor', 0).successful
    ros.do('reset')
    for _ in range(3):
        clock.next()
    stamps = np.array([ns(message.clock) for message in clock.messages])
    assert np.all(np.diff(stamps) > 0)


def test_the_clock_is_left_alone_on_wish(ros, sim):
    sim(publish_clock=False)
    clock, poses = ros.listen('/clock'), ros.listen('poses')
    poses.wait_for_count(5)
    assert not clock.messages


def test_the_node_does_not_wait_for_its_own_clock(ros, sim):
    sim(use_sim_time=True, start_paused=True)
    ros.listen('/diagnostics').wait_for_count(2)
    ros.do('throw')


def test_after_its_duration_a_run_stands_still_and_says_so(ros, sim):
    finished = threading.Event()
    simulator = sim(duration=0.05, real_time_factor=0.0, options={'on_finished': finished.set})
    assert finished.wait(DEADLINE)
    assert simulator.simulation.world.time_ns == 50_000_000
    ros.do('pause', True)
    assert 'duration' in ros.refuse('step')
    assert simulator.simulation.world.time_ns == 50_000_000


def test_a_clean_end_refuses_what_comes_later(ros, sim):
    simulator = sim()
    ros.do('throw')
    simulator.close()
    assert 'stopped' in ros.refuse('throw')
    assert 'stopped' in ros.refuse('record', True)
    assert simulator.close() is None, 'closing twice does no harm'
