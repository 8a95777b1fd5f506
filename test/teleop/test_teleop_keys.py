"""Keys, the velocity they make, and what is shown of them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from cube_sim.physics.world import turned_by
from cube_sim.remote import Status
from cube_sim.teleop.flight import FIRST_HOLD, NEXT_HOLD, PERIOD, TAP_SHARE, Flight, yaw_of
from cube_sim.teleop.keys import ESCAPE_DELAY, LAYOUTS, MOTIONS, KeyReader
from cube_sim.teleop.screen import View, lines

LEVEL = np.array([0.0, 0, 0, 0, 0, 0, 1])


def test_keys_of_all_kinds_are_named():
    reader = KeyReader()
    typed = b'zQ \t\x1b[A\x1bOB\x1b[1;5C\x1b[D\x1b[3~b'
    assert reader.feed(typed, 0.0) == [
        *('z', 'q', 'space', 'tab', 'up', 'down', 'right', 'left', 'b')
    ]


def test_an_arrow_that_comes_in_pieces_is_an_arrow_and_a_lone_escape_an_escape():
    reader = KeyReader()
    assert reader.feed(b'\x1b', 0.0) == []
    assert reader.feed(b'[A', 0.5 * ESCAPE_DELAY) == ['up']
    assert reader.feed(b'\x1b', 1.0) == []
    assert reader.wait(1.0) == pytest.approx(ESCAPE_DELAY)
    assert reader.feed(b'', 1.0 + ESCAPE_DELAY) == ['escape']
    assert reader.wait(2.0) is None


def test_the_layouts_have_a_key_for_each_motion_and_the_reports_keys_are_azerty():
    for layout in LAYOUTS.values():
        assert set(MOTIONS) <= set(layout.values())
    french = LAYOUTS['azerty']
    assert [french[key] for key in 'zsqdea'] == ['forward', 'back', 'left', 'right', 'up', 'down']


@pytest.mark.parametrize('delay', [0.25, 0.5, 0.66])
def test_a_held_key_flies_without_a_gap_from_the_first_press_on(delay):
    """For the keyboards of terminals: a first delay, then some 11 to 30 repeats a second."""
    for repeat in (0.033, 0.092):
        flight = Flight(3.0, 1.0)
        presses = [0.0, *np.arange(delay, 2.0, repeat)]
        now, speeds = 0.0, []
        while now < 2.0:
            while presses and presses[0] <= now:
                flight.press('forward', presses.pop(0))
            due = flight.due(now, LEVEL)
            if due is not None:
                speeds.append(due[0][0])
            now += 0.01
        assert min(speeds) == pytest.approx(3.0 * TAP_SHARE)
        assert max(speeds) == speeds[-1] == pytest.approx(3.0)
        assert len(speeds) >= 2.0 / PERIOD * 0.8


def test_a_tap_ends_with_one_stop():
    flight = Flight(3.0, 1.0)
    flight.press('up', 0.0)
    assert flight.due(0.0, LEVEL)[0] == pytest.approx([0, 0, 3.0 * TAP_SHARE])
    stop = flight.due(FIRST_HOLD, LEVEL)
    assert not stop[0].any()
    assert not stop[1].any()
    assert flight.due(FIRST_HOLD + PERIOD, LEVEL) is None
    assert flight.wait(FIRST_HOLD + PERIOD) is None


def test_an_opposite_key_turns_round_at_once():
    flight = Flight(3.0, 1.0)
    flight.press('left', 0.0)
    flight.press('right', 0.1)
    assert flight.due(0.1, LEVEL)[0][1] < 0.0
    flight.press('right', 0.1 + FIRST_HOLD - NEXT_HOLD)
    assert flight.due(0.2 + NEXT_HOLD, LEVEL)[0][1] == pytest.approx(-3.0)


def test_looking_aside_keeps_the_horizon_level_whatever_the_camera_looks_at():
    down = np.array([0, 0, 0, 0, math.sin(0.4), 0, math.cos(0.4)])
    flight = Flight(3.0, 1.0)
    flight.press('look left', 0.0)
    _, spin = flight.due(0.0, down)
    assert turned_by(down[3:], spin) == pytest.approx([0, 0, TAP_SHARE])
    assert yaw_of((0, 0, math.sin(0.3), math.cos(0.3))) == pytest.approx(0.6)


def test_the_camera_does_not_look_over_backwards():
    half = math.radians(86.0) / 2
    down = np.array([0, 0, 0, 0, math.sin(half), 0, math.cos(half)])
    flight = Flight(3.0, 1.0)
    flight.press('look down', 0.0)
    assert flight.due(0.0, down)[1][1] == 0.0
    flight.press('look up', 0.1)
    assert flight.due(0.1, down)[1][1] < 0.0


@pytest.mark.parametrize(('columns', 'rows'), [(80, 24), (200, 60), (59, 24), (20, 5), (1, 1)])
@pytest.mark.parametrize('present', [True, False])
def test_whatever_the_size_nothing_is_too_wide_or_too_long(columns, rows, present):
    status = Status('impulse', 1000, 1000, 10**13, True, 0.5, '/a/long/path' * 9, 'behind')
    view = View('/cube_sim', 'azerty', present, status, LEVEL, 'a long answer ' * 9)
    shown = lines(view, columns, rows, styled=False)
    assert len(shown) <= rows
    assert max(map(len, shown)) <= columns


def test_at_80_by_24_everything_has_its_place():
    status = Status('impulse', 12, 1000, 3_400_000_000, False, 1.0, '', '')
    view = View('/cube_sim', 'azerty', True, status, LEVEL, 'cube 11 thrown')
    shown = '\n'.join(lines(view, 80, 24, styled=False))
    for text in (
        'impulse',
        '12 of 1000',
        '3.40 s',
        'Z S',
        'Tab',
        'Esc',
        '> cube 11 thrown',
        'none',
    ):
        assert text in shown
