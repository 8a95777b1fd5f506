"""What teleop_key shows, as lines of text."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cube_sim.remote import Status
from cube_sim.teleop.flight import pitch_of, yaw_of

_BOLD, _DIM, _REVERSE, _PLAIN = '\x1b[1m', '\x1b[2m', '\x1b[7m', '\x1b[0m'

_KEYS = {
    'azerty': ('Z S', 'Q D', 'E A', 'QWERTY'),
    'qwerty': ('W S', 'A D', 'E Q', 'AZERTY'),
}


@dataclass(frozen=True)
class View:
    """All that is shown."""

    simulator: str
    layout: str
    present: bool
    status: Status
    camera: NDArray[np.float64] | None = None
    note: str = ''
    """The last answer, or what is wrong."""


def lines(view: View, columns: int, rows: int, *, styled: bool = True) -> list[str]:
    """Return at most `rows` lines, each at most `columns` wide, escape sequences not counted."""
    title = f' cube_sim teleop_key   {view.simulator}'
    # In the order in which they are given up when there is no room, the last first.
    state = _state(view, columns)
    note = f' > {view.note}' if view.note else ''
    blocks: list[tuple[str, str]] = [(_REVERSE, title.ljust(columns)), (_BOLD, note)]
    keys = _keys(view.layout, columns)
    room = rows - len(blocks)
    body: list[tuple[str, str]] = [('', text) for text in state[: max(0, room)]]
    room -= len(body)
    shown = keys[: max(0, room - 1)]
    if shown:
        body += [('', ''), *((_DIM, text) for text in shown)]
        room -= len(shown) + 1
    spaced = [('', '')] if room >= 2 else []
    laid = [blocks[0], *spaced, *body, *spaced, blocks[1]]
    return [_line(style, text, columns, styled) for style, text in laid[:rows]]


def _state(view: View, columns: int) -> list[str]:
    if not view.present:
        return [
            f' No simulator answers on {view.simulator}.',
            ' sim_node or make run starts one; waiting for it ...',
        ]
    status = view.status
    pace = 'paused' if status.paused else f'real-time factor {status.factor:.2f}'
    found = [
        f' model   {status.model:<10} cubes {status.cubes:>6} of {status.max_cubes}',
        f' time    {status.time_ns / 1e9:>9.2f} s   {pace}',
        f' camera  {_place(view.camera)}',
        f' bag     {_ending(status.bag or "none", columns - 9)}',
    ]
    return [*found, f' ! {status.warning}'] if status.warning else found


def _ending(path: str, columns: int) -> str:
    """Return the end of a path that is too long: that is where its name is."""
    return path if len(path) <= columns else f'…{path[len(path) - columns + 1 :]}'


def _place(camera: NDArray[np.float64] | None) -> str:
    if camera is None:
        return ''
    x, y, z = camera[:3]
    yaw, up = math.degrees(yaw_of(camera[3:])), -math.degrees(pitch_of(camera[3:]))
    return f'x {x:.1f}  y {y:.1f}  z {z:.1f} m   turned {yaw:.0f}°, up {up:.0f}°'


def _keys(layout: str, columns: int) -> list[str]:
    ahead, aside, height, other = _KEYS[layout]
    left = [
        (ahead, 'forward, back'),
        (aside, 'left, right'),
        (height, 'up, down'),
        ('↑ ↓', 'look up, down'),
        ('← →', 'look left, right'),
        ('L', f'{other} keys'),
    ]
    right = [
        ('Space', 'throw a cube'),
        ('Tab', 'next physics model'),
        ('R', 'remove all cubes'),
        ('P', 'pause, go on'),
        ('N', 'one step, when paused'),
        ('B', 'record a bag, on and off'),
        ('Esc', 'leave'),
    ]
    if columns < 60:
        return [f' {key:<6} {does}' for key, does in (*right[:2], *left, *right[2:])]
    pairs = []
    for i, (key, does) in enumerate(right):
        one, what = left[i] if i < len(left) else ('', '')
        pairs.append(f' {one:<5}{what:<24}{key:<7}{does}')
    return pairs


def _line(style: str, text: str, columns: int, styled: bool) -> str:
    if len(text) > columns:
        text = text[: columns - 1] + '…'
    return f'{style}{text}{_PLAIN}' if styled and style and text else text
