"""A bag on a page and as a file, without ROS running."""

from __future__ import annotations

import subprocess
import sys

import pytest
from support.bag_of_throws import PERIOD_NS

from cube_sim.recording import RecordingError
from cube_sim.web import playback
from cube_sim.web.playback import Recorded


def test_the_frames_of_a_bag_are_those_of_the_run(bag):
    run = Recorded.read(bag)
    counts = [len(frame) for frame in run.frames]
    assert run.times == sorted(run.times)
    assert run.times[-1] == 50 * PERIOD_NS
    assert counts[0] == 1
    assert max(counts) == 2
    assert counts[-1] == 0
    assert run.frames[run.index_at(100_000_000)].shape == (1, 7)
    assert run.camera_at(0)[2] == 1.5
    assert run.camera_at(300_000_000)[2] == 2.0
    assert run.settings_at(300_000_000)['cube_size'] == 0.5
    assert run.settings_at(500_000_000)['cube_size'] == 0.6
    assert run.settings_at(500_000_000)['physics_model'] == 'impulse'
    assert run.ground is not None


def test_a_run_too_long_for_memory_is_thinned_out(bag, monkeypatch):
    whole = Recorded.read(bag)
    monkeypatch.setattr(playback, 'BUDGET', 28 * 20)
    thin = Recorded.read(bag)
    assert len(thin.times) < len(whole.times)
    assert thin.times == sorted(thin.times)


def test_what_is_no_bag_is_refused_in_a_sentence(tmp_path):
    with pytest.raises(RecordingError):
        Recorded.read(tmp_path / 'nothing')


def test_an_exported_file_plays_offline(bag, tmp_path, chromium):
    """As web_view does it, in a process where ROS is not even imported."""
    page_file = tmp_path / 'run.html'
    code = (
        'import sys; from cube_sim.web.main import main; code = main(sys.argv[1:]); '
        "sys.exit(code or ('rclpy' in sys.modules))"
    )
    command = [sys.executable, '-c', code, '--bag', str(bag), '--export', str(page_file)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert 'frames' in done.stdout
    again = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert again.returncode == 2
    assert 'exists already, not overwriting' in again.stderr
    page = chromium.open(page_file.as_uri())
    page.wait_for("document.querySelector('canvas')")
    # The player's slider, which moves by itself.
    page.wait_for("+document.querySelector('input[type=hidden]').value > 0")
    assert not page.errors
    assert not [url for url in page.requests if url.startswith(('http:', 'https:', 'ws'))]


def test_a_bag_plays_on_a_page_and_its_slider_moves(bag, chromium):
    from cube_sim.web.player import Player
    from cube_sim.web.stage import serving

    with serving('127.0.0.1', 0, 'cube_sim') as server:
        player = Player(server, Recorded.read(bag), shadows=False)
        player.start()
        try:
            page = chromium.open(f'http://127.0.0.1:{server.get_port()}')
            page.wait_for("document.body.innerText.includes('of 1.00 s')")
            page.wait_for("document.body.innerText.includes('2 cubes')")
            page.press(' ', 'Space', 32)
            page.wait_for('document.querySelector("input[type=checkbox]").checked === false')
            assert player.shown >= 0
            assert not page.errors
        finally:
            player.close()
