"""A program of the project in a process of its own, as a person starts it."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterable
from pathlib import Path
from typing import IO

import pytest
from node.ros_session import DEADLINE

import cube_sim

_ROOT = Path(cube_sim.__file__).resolve().parents[1]
_SHARED_MEMORY = '/dev/shm/'


class RosProcess:
    """Runs `python -m MODULE ARGUMENTS`, collects what it writes, and ends it for sure."""

    def __init__(self, domain: int, directory: Path, module: str, arguments: Iterable[str]) -> None:
        """Start in `directory` on `domain`."""
        # Set by the Python that runs the tests; the other one has to set up its own libraries.
        kept = {k: v for k, v in os.environ.items() if k != '_ROS_WHEELS_BOOTSTRAP_COMPLETE'}
        paths = [str(_ROOT), *filter(None, [os.environ.get('PYTHONPATH')])]
        self._process = subprocess.Popen(
            [sys.executable, '-m', module, *arguments],
            cwd=directory,
            env={
                **kept,
                'ROS_DOMAIN_ID': str(domain),
                'PYTHONPATH': os.pathsep.join(paths),
                'RCUTILS_COLORIZED_OUTPUT': '0',
            },
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self._process.stdout
        assert self._process.stderr
        self.left_behind: set[str] = set()
        self._changed = threading.Condition()
        self._open = 2
        self._written: dict[str, list[str]] = {'stdout': [], 'stderr': []}
        self._readers = [
            threading.Thread(target=self._read, args=args)
            for args in (('stdout', self._process.stdout), ('stderr', self._process.stderr))
        ]
        for reader in self._readers:
            reader.start()

    @property
    def pid(self) -> int:
        """The process's id."""
        return self._process.pid

    @property
    def output(self) -> str:
        """What it has written to stdout so far; all of it after `wait`."""
        with self._changed:
            return ''.join(self._written['stdout'])

    @property
    def errors(self) -> str:
        """What it has written to stderr so far; all of it after `wait`."""
        with self._changed:
            return ''.join(self._written['stderr'])

    def wait_for_line(self, part: str, stream: str = 'stdout') -> str:
        """Wait for a line that contains `part`, and return it."""
        lines = self._written[stream]

        def found() -> str | None:
            return next((line for line in lines if part in line), None)

        def came_or_ended() -> bool:
            return found() is not None or self._open == 0

        with self._changed:
            self._changed.wait_for(came_or_ended, DEADLINE)
            line = found()
        if line is None:
            pytest.fail(f'no {part!r} on {stream}: {self.output}\n{self.errors}')
        return line.rstrip('\n')

    def interrupt(self) -> None:
        """Do what Ctrl-C does."""
        self.send(signal.SIGINT)

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self._process.send_signal(number)

    def wait(self) -> int:
        """Wait for the end and return the exit code; no traceback may have been written."""
        try:
            code = self._process.wait(DEADLINE)
        except subprocess.TimeoutExpired:
            pytest.fail(f'process does not end: {self.output}\n{self.errors}')
        for reader in self._readers:
            reader.join(DEADLINE)
        assert 'Traceback' not in self.errors, self.errors
        return code

    def kill(self) -> None:
        """Kill it as the system would; what it leaves in shared memory is in `left_behind`."""
        self.left_behind = _shared_memory_of(self.pid)
        self._process.kill()
        self._process.wait()

    def close(self) -> None:
        """End it if it runs still."""
        if self._process.poll() is None:
            self.kill()
        for reader in self._readers:
            reader.join(DEADLINE)
        for stream in (self._process.stdout, self._process.stderr):
            if stream:
                stream.close()

    def _read(self, name: str, stream: IO[str]) -> None:
        for line in stream:
            with self._changed:
                self._written[name].append(line)
                self._changed.notify_all()
        with self._changed:
            self._open -= 1
            self._changed.notify_all()


def remove_unused(left_behind: set[str]) -> None:
    """Remove those of these files in shared memory that no process uses any more."""
    running = [int(entry) for entry in os.listdir('/proc') if entry.isdigit()]
    for name in left_behind.difference(*(_shared_memory_of(pid) for pid in running)):
        Path(name).unlink(missing_ok=True)


def _shared_memory_of(pid: int) -> set[str]:
    """Return the files of Fast DDS in shared memory that a process has mapped or open."""
    found = set()
    try:
        for line in Path(f'/proc/{pid}/maps').read_text().splitlines():
            found.add(line.split(maxsplit=5)[-1])
        for link in Path(f'/proc/{pid}/fd').iterdir():
            found.add(str(link.readlink()))
    except OSError:  # it has ended, or belongs to somebody else
        pass
    prefixes = (f'{_SHARED_MEMORY}fastrtps_', f'{_SHARED_MEMORY}sem.fastrtps_')
    return {name for name in found if name.startswith(prefixes)}
