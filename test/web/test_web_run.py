"""What the topics say, in the order in which it is to be shown."""

from __future__ import annotations

import numpy as np

from cube_sim.messages import events, poses
from cube_sim.web.run import Run


def of(count):
    rows = np.zeros((count, 7))
    rows[:, 0], rows[:, 6] = np.arange(count), 1.0
    return rows


def posed(time_ns, count):
    return poses.pose_array(time_ns, 'world', of(count))


def thrown(time_ns, index):
    return events.odometry(time_ns, 'world', f'cube_{index}', of(index + 1)[index], np.zeros(6))


def test_only_the_latest_frame_is_kept():
    run = Run()
    for time_ns in range(1, 101):
        run.take_poses(posed(time_ns, 3))
    frame = run.frame()
    assert (frame.time_ns, len(frame.poses)) == (100, 3)
    assert run.wait(frame.number - 1, 0.0)
    assert not run.wait(frame.number, 0.0)


def test_a_throw_shows_at_once_and_older_poses_that_come_late_do_not_take_it_away():
    run = Run()
    run.take_poses(posed(40, 1))
    run.take_throw(thrown(60, 1))
    assert len(run.frame().poses) == 2
    run.take_poses(posed(60, 1))
    assert len(run.frame().poses) == 2
    run.take_poses(posed(80, 2))
    assert run.frame().time_ns == 80


def test_a_reset_shows_at_once_but_not_one_from_before_the_poses():
    run = Run()
    run.take_poses(posed(100, 4))
    run.take_reset(events.header(50, 'world'))
    assert len(run.frame().poses) == 4
    run.take_reset(events.header(100, 'world'))
    assert len(run.frame().poses) == 0
    run.take_poses(posed(100, 4))
    assert len(run.frame().poses) == 0


def test_a_simulator_that_starts_anew_is_followed_although_its_time_is_earlier():
    run = Run()
    run.take_poses(posed(10**12, 5))
    run.take_reset(events.header(10**12, 'world'))
    run.take_poses(posed(20, 1))
    assert (run.frame().time_ns, len(run.frame().poses)) == (20, 1)


def test_the_size_of_the_cubes_comes_from_the_settings():
    run = Run()
    run.take_settings(events.parameter_event(0, '/cube_sim', {}, {'cube_size': 0.25}))
    assert run.frame().cube_size == 0.25
    run.clear()
    assert len(run.frame().poses) == 0
