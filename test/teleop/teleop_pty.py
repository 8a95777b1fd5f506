"""teleop_key in a real terminal, as a person has it."""

from __future__ import annotations

import fcntl
import os
import pty
import re
import signal
import struct
import subprocess
import sys
import termios
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

import cube_sim

DEADLINE = 20.0
_STYLES = re.compile(r'\x1b\[[0-9;?]*[A-Za-z]')


class TeleopTerminal:
    """A pseudo-terminal with the program in it; what it shows is collected."""

    def __init__(self, directory: Path, arguments: Sequence[str], columns: int, rows: int) -> None:
        """Start `teleop_key ARGUMENTS` in a terminal of that size."""
        self._master, self._slave = pty.openpty()
        self.resize(columns, rows, tell=False)
        self.mode_before = self._mode()
        root = str(Path(cube_sim.__file__).parents[1])
        kept = {k: v for k, v in os.environ.items() if k != '_ROS_WHEELS_BOOTSTRAP_COMPLETE'}
        self._process = subprocess.Popen(
            [sys.executable, '-m', 'cube_sim.teleop.main', *arguments],
            stdin=self._slave,
            stdout=self._slave,
            stderr=subprocess.PIPE,
            cwd=directory,
            env={**kept, 'PYTHONPATH': root, 'TERM': 'xterm-256color'},
            start_new_session=True,
        )
        self._changed = threading.Condition()
        self._shown = ''
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """The process's id."""
        return self._process.pid

    def type(self, text: str) -> None:
        """Type on the keyboard."""
        os.write(self._master, text.encode())

    def resize(self, columns: int, rows: int, *, tell: bool = True) -> None:
        """Change the size of the window."""
        fcntl.ioctl(self._slave, termios.TIOCSWINSZ, struct.pack('HHHH', rows, columns, 0, 0))
        if tell:
            self.send(signal.SIGWINCH)

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self._process.send_signal(number)

    def wait_for(self, text: str, *, after: int = 0) -> str:
        """Wait until `text` has been shown behind the first `after` characters; return all."""
        with self._changed:
            came = self._changed.wait_for(
                lambda: text in _STYLES.sub('', self._shown[after:]), DEADLINE
            )
            if not came:
                pytest.fail(f'{text!r} is not shown: {_STYLES.sub("", self._shown[-3000:])}')
            return self._shown

    def mark(self) -> int:
        """Return how much has been shown, for `wait_for`."""
        with self._changed:
            return len(self._shown)

    def wait(self) -> int:
        """Wait for the end, and that the terminal was given back; return the exit code."""
        try:
            code = self._process.wait(DEADLINE)
        except subprocess.TimeoutExpired:
            pytest.fail(f'teleop_key does not end: {self._shown[-2000:]}')
        assert self._process.stderr
        errors = self._process.stderr.read().decode()
        assert 'Traceback' not in errors, errors
        assert self._mode() == self.mode_before
        self.wait_for('')
        with self._changed:
            given_back = self._changed.wait_for(lambda: '\x1b[?1049l' in self._shown, DEADLINE)
        assert given_back, 'the other screen was not left'
        assert self._shown.rindex('\x1b[?25h') > self._shown.rindex('\x1b[?25l')
        return code

    def close(self) -> None:
        """End it for sure."""
        if self._process.poll() is None:
            self._process.kill()
        self._process.wait(DEADLINE)
        if self._process.stderr:
            self._process.stderr.close()
        os.close(self._slave)
        self._reader.join(DEADLINE)
        os.close(self._master)

    def _mode(self) -> list[Any]:
        return termios.tcgetattr(self._slave)

    def _read(self) -> None:
        while True:
            try:
                data = os.read(self._master, 65536)
            except OSError:
                return
            if not data:
                return
            with self._changed:
                self._shown += data.decode(errors='replace')
                self._changed.notify_all()
