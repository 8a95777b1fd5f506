"""A terminal, taken over and given back, whatever happens."""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import termios
from collections.abc import Callable
from types import FrameType, TracebackType
from typing import Any

_ENTER = '\x1b[?1049h\x1b[?25l\x1b[2J'  # other screen, no cursor, empty
_LEAVE = '\x1b[0m\x1b[?25h\x1b[?1049l'
_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


class Terminal:
    """
    As a context: keys come at once and unseen, and the screen is ours.

    Signals only set `ended` or wake `wait`, so that the end is always the one of the context. For
    use in the main thread.
    """

    def __init__(self) -> None:
        """Take stdin and stdout, which have to be terminals."""
        self.ended = False
        self._in = sys.stdin.fileno()
        self._saved: list[Any] = []
        self._handlers: dict[int, Any] = {}
        self._shown: list[str] | None = None
        self._asleep, self._alarm = os.pipe()
        os.set_blocking(self._alarm, False)
        os.set_blocking(self._asleep, False)

    def __enter__(self) -> Terminal:
        self._saved = termios.tcgetattr(self._in)
        for number in (*_ENDING, signal.SIGWINCH, signal.SIGTSTP, signal.SIGCONT):
            self._handlers[number] = signal.signal(number, self._signalled)
        self._take()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._give_back()
        for number, handler in self._handlers.items():
            # A second Ctrl-C is not to end the program in the middle of its end.
            if number not in _ENDING:
                signal.signal(number, handler)

    def wake(self) -> None:
        """Let `wait` return; from any thread."""
        with contextlib.suppress(BlockingIOError):
            os.write(self._alarm, b'.')

    def wait(self, seconds: float) -> bytes:
        """Wait for keys, signals or `wake`, for that long at most; return what was typed."""
        with contextlib.suppress(InterruptedError):
            ready, _, _ = select.select([self._in, self._asleep], [], [], seconds)
            if self._asleep in ready:
                with contextlib.suppress(BlockingIOError):
                    os.read(self._asleep, 4096)
            if self._in in ready:
                try:
                    data = os.read(self._in, 4096)
                except OSError:  # the terminal has gone
                    data = b''
                self.ended = self.ended or not data
                return data
        return b''

    def draw(self, make: Callable[[int, int], list[str]]) -> None:
        """Show what `make` returns for the columns and rows there are."""
        try:
            columns, rows = os.get_terminal_size(sys.stdout.fileno())
        except OSError:  # the terminal has gone
            return
        if columns == 0 or rows == 0:  # of a terminal that does not know
            columns, rows = 80, 24
        lines = make(columns, rows)
        if lines == self._shown:
            return
        self._shown = lines
        # Each line is cleared behind its text: nothing flickers, and nothing old stays.
        text = '\r\n'.join(f'{line}\x1b[K' for line in lines)
        self._write(f'\x1b[H{text}\x1b[0J')

    def _take(self) -> None:
        mode = termios.tcgetattr(self._in)
        mode[0] &= ~(termios.IXON | termios.ICRNL)
        mode[3] &= ~(termios.ICANON | termios.ECHO)
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
        termios.tcsetattr(self._in, termios.TCSADRAIN, mode)
        self._shown = None
        self._write(_ENTER)

    def _give_back(self) -> None:
        self._write(_LEAVE)
        with contextlib.suppress(termios.error, OSError):
            termios.tcsetattr(self._in, termios.TCSADRAIN, self._saved)

    def _write(self, text: str) -> None:
        with contextlib.suppress(OSError):  # the terminal has gone
            sys.stdout.write(text)
            sys.stdout.flush()

    def _signalled(self, number: int, _: FrameType | None) -> None:
        if number in _ENDING:
            self.ended = True
        elif number == signal.SIGTSTP:
            self._give_back()
            os.kill(os.getpid(), signal.SIGSTOP)
        elif number == signal.SIGCONT:
            self._take()
        else:
            self._shown = None
        self.wake()
