"""The executables web_view and cube_sim_game, as a person starts them."""

from __future__ import annotations

import re
import subprocess
import sys
import urllib.request

import pytest


def test_the_game_serves_its_page_and_ends_with_the_bags_path(run_module, tmp_path):
    game = run_module(
        *('cube_sim.web.game', '--port', '0', '--no-open', '--ros-args'),
        *('-p', 'record:=true', '-p', f'bag_directory:={tmp_path / "bags"}'),
    )
    url = game.wait_for_line('page: ').split()[1]
    with urllib.request.urlopen(url, timeout=20) as answer:
        assert b'<html' in answer.read()
    game.wait_for_line('real-time factor')
    game.interrupt()
    assert game.wait() == 0
    assert re.search(rf'^bag: {re.escape(str(tmp_path / "bags"))}/\S+$', game.output, re.M)
    assert 'Space' in game.output


def test_the_game_ends_with_its_simulator(run_module):
    game = run_module(
        *('cube_sim.web.game', '--port', '0', '--no-open', '--ros-args', '-p', 'duration:=0.2')
    )
    assert game.wait() == 0


def test_web_view_says_that_no_simulator_answers_and_when_one_does(run_module, sim_process):
    view = run_module('cube_sim.web.main', '--port', '0')
    view.wait_for_line('page: http://127.0.0.1:')
    view.wait_for_line('No simulator answers on /cube_sim')
    sim_process()
    view.wait_for_line('/cube_sim answers.')
    view.interrupt()
    assert view.wait() == 0


@pytest.mark.parametrize(
    ('arguments', 'reason'),
    [
        (['--host', '203.0.113.7'], 'no such address'),
        (['--port', '-1'], '0 to 65535'),
        (['--export', 'x.html'], '--bag'),
        (['--bag', 'nothing_here'], 'nothing_here'),
        (['--simulator', 'not a name'], 'not a name'),
    ],
)
def test_what_cannot_be_is_refused_in_a_sentence(arguments, reason):
    done = subprocess.run(
        [sys.executable, '-m', 'cube_sim.web.main', *arguments],
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert done.returncode == 2
    assert reason in done.stderr
    assert 'Traceback' not in done.stderr


def test_the_node_does_not_need_what_the_page_is_made_with():
    code = "import cube_sim.node.main, cube_sim.node.node, sys; print('viser' in sys.modules)"
    done = subprocess.run(
        [sys.executable, '-c', code], capture_output=True, text=True, timeout=30, check=True
    )
    assert done.stdout.strip() == 'False'
