"""teleop_key in a terminal, with a simulator and without."""

from __future__ import annotations

import signal
import subprocess
import sys

import pytest


def test_keys_throw_switch_pause_step_and_reset(sim, teleop):
    node = sim(physics_model='simple')
    terminal = teleop()
    terminal.wait_for('model   simple')
    terminal.type(' ')
    terminal.wait_for('cube 0 thrown')
    terminal.type(' ')
    terminal.wait_for('cube 1 thrown')
    terminal.type('\t')
    terminal.wait_for('model impulse')
    terminal.type('p')
    terminal.wait_for('paused at')
    terminal.type('n')
    terminal.wait_for('> at ')
    terminal.type('r')
    terminal.wait_for('2 cubes removed')
    terminal.type('\x1b')
    assert terminal.wait() == 0
    assert len(node.simulation.world) == 0
    assert node.simulation.world.settings.model == 'impulse'
    assert node.runner.paused


def test_a_key_flies_the_camera_forward_and_an_arrow_turns_it(ros, sim, teleop):
    sim()
    camera = ros.listen('camera/pose')
    terminal = teleop()
    terminal.wait_for('camera  x 0.0')
    terminal.type('z')
    camera.wait_for(lambda message: message.pose.position.x > 0.3)
    terminal.type('\x1b[D')
    camera.wait_for(lambda message: message.pose.orientation.z > 0.03)
    at = camera.last.pose.orientation
    assert (at.x, at.y) == (0.0, 0.0)
    terminal.type('\x1b')
    assert terminal.wait() == 0


def test_the_layout_decides_which_keys_fly(ros, sim, teleop):
    sim()
    camera = ros.listen('camera/pose')
    terminal = teleop('--layout', 'qwerty')
    terminal.wait_for('camera  x 0.0')
    terminal.type('a')
    camera.wait_for(lambda message: message.pose.position.y > 0.3)
    terminal.type('l')
    terminal.wait_for('Z S')
    terminal.type('\x1b')
    assert terminal.wait() == 0


def test_a_recording_is_shown_and_its_path_printed_at_the_end(ros, sim, teleop, tmp_path):
    node = sim()
    clock = ros.listen('/clock')
    terminal = teleop(columns=250)
    terminal.wait_for('bag     none')
    terminal.type('b')
    terminal.wait_for('recording ')
    terminal.wait_for(f'bag     {tmp_path / "bags"}')
    # What comes sooner would be a key that is held.
    then = clock.last.clock.sec + clock.last.clock.nanosec / 1e9 + 0.5
    clock.wait_for(lambda now: now.clock.sec + now.clock.nanosec / 1e9 > then)
    mark = terminal.mark()
    terminal.type('b')
    terminal.wait_for('bag     none', after=mark)
    assert node.bag_path is None
    terminal.type('\x1b')
    assert terminal.wait() == 0
    terminal.wait_for('bag: ')


def test_without_a_simulator_it_says_so_and_finds_the_one_that_comes(sim, teleop):
    terminal = teleop()
    terminal.wait_for('No simulator answers on /cube_sim')
    terminal.type(' ')
    terminal.wait_for('sim_node or make run starts one')
    sim()
    terminal.wait_for('model   simple')
    terminal.type('\x1b')
    assert terminal.wait() == 0


def test_a_simulator_that_ends_is_missed_and_the_terminal_stays_whole(sim_process, teleop):
    simulator = sim_process()
    terminal = teleop()
    terminal.wait_for('model   simple')
    mark = terminal.mark()
    simulator.kill()
    terminal.wait_for('No simulator answers', after=mark)
    terminal.send(signal.SIGTERM)
    assert terminal.wait() == 0


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_ends_it_and_gives_the_terminal_back(teleop, number):
    terminal = teleop()
    terminal.wait_for('cube_sim teleop_key')
    terminal.send(number)
    assert terminal.wait() == 0


def test_what_is_shown_follows_the_size_of_the_window(teleop):
    terminal = teleop(columns=80, rows=24)
    terminal.wait_for('Esc    leave')
    mark = terminal.mark()
    terminal.resize(40, 10)
    shown = terminal.wait_for('No simulator answers on /cube_sim.', after=mark)[mark:]
    assert 'record a bag, on and off' not in shown
    mark = terminal.mark()
    terminal.resize(80, 24)
    terminal.wait_for('Esc    leave', after=mark)
    terminal.send(signal.SIGINT)
    assert terminal.wait() == 0


def test_where_there_is_no_terminal_it_says_so():
    ended = subprocess.run(
        [sys.executable, '-m', 'cube_sim.teleop.main'],
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=20,
        check=False,
    )
    assert ended.returncode == 2
    assert 'terminal' in ended.stderr
    assert 'Traceback' not in ended.stderr
