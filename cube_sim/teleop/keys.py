"""The bytes of a terminal as keys, and what each key does."""

from __future__ import annotations

import re

# How long after an Escape the rest of an arrow's sequence may take, s.
ESCAPE_DELAY = 0.05

# A control sequence (CSI), or the two characters that follow ESC O (SS3).
_SEQUENCE = re.compile(r'\x1b(\[[0-?]*[ -/]*[@-~]|O[ -~])')
_UNFINISHED = re.compile(r'\x1b(\[[0-?]*[ -/]*|O)?$')
_ARROWS = {'A': 'up', 'B': 'down', 'C': 'right', 'D': 'left'}
_NAMES = {' ': 'space', '\t': 'tab'}

# What a motion does: camera axis (x forward, y left, z up; then the turns about them) and sign.
MOTIONS: dict[str, tuple[int, float]] = {
    'forward': (0, 1.0),
    'back': (0, -1.0),
    'left': (1, 1.0),
    'right': (1, -1.0),
    'up': (2, 1.0),
    'down': (2, -1.0),
    'look down': (4, 1.0),
    'look up': (4, -1.0),
    'look left': (5, 1.0),
    'look right': (5, -1.0),
}

_SHARED = {
    's': 'back',
    'd': 'right',
    'e': 'up',
    'up': 'look up',
    'down': 'look down',
    'left': 'look left',
    'right': 'look right',
    'space': 'throw',
    'tab': 'next_model',
    'r': 'reset',
    'p': 'pause',
    'n': 'step',
    'b': 'record',
    'l': 'layout',
    'escape': 'leave',
}
# The report's keys, and those in the same places of an English keyboard.
LAYOUTS: dict[str, dict[str, str]] = {
    'azerty': {**_SHARED, 'z': 'forward', 'q': 'left', 'a': 'down'},
    'qwerty': {**_SHARED, 'w': 'forward', 'a': 'left', 'q': 'down'},
}


class KeyReader:
    """Names keys: letters in lower case, and up, down, left, right, space, tab, escape."""

    def __init__(self) -> None:
        self._pending = ''
        self._since = 0.0

    def feed(self, data: bytes, now: float) -> list[str]:
        """Return the keys that are complete with `data`, read at `now`."""
        if data:
            self._pending += data.decode('latin-1')
            self._since = now
        found = []
        while self._pending:
            first = self._pending[0]
            if first != '\x1b':
                found.append(_NAMES.get(first, first.lower()))
                self._pending = self._pending[1:]
                continue
            sequence = _SEQUENCE.match(self._pending)
            if sequence:
                arrow = _ARROWS.get(sequence[0][-1])
                found += [arrow] if arrow else []
                self._pending = self._pending[sequence.end() :]
            elif _UNFINISHED.match(self._pending) and now - self._since < ESCAPE_DELAY:
                break
            else:
                found.append('escape')
                self._pending = self._pending[1:]
        return found

    def wait(self, now: float) -> float | None:
        """Return how long it is until an Escape that stands alone counts, s."""
        return max(0.0, self._since + ESCAPE_DELAY - now) if self._pending else None
