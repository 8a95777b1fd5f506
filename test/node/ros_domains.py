"""A ROS domain that no other test on this machine uses at the same time."""

from __future__ import annotations

import fcntl
import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

# Above 101 the ports of DDS fall into the range that the system gives to clients.
DOMAINS = range(1, 102)


class Domains:
    """
    Hands out domains; a byte of a file in the temporary directory is locked for each in use.

    One after another is taken, so that what a killed process leaves on one does not meet the
    next test. The locks go with the process, whatever becomes of it.
    """

    def __init__(self) -> None:
        """Open the file of this user's locks; once in a process, as closing it frees them all."""
        path = Path(tempfile.gettempdir()) / f'cube_sim_test_domains_{os.getuid()}'
        self._file = path.open('ab')
        self._used: set[int] = set()
        self._next = os.getpid()

    @contextmanager
    def one(self) -> Iterator[int]:
        """Take a domain for as long as the block lasts."""
        domain = self._take()
        try:
            yield domain
        finally:
            fcntl.lockf(self._file, fcntl.LOCK_UN, 1, domain)
            self._used.remove(domain)

    def _take(self) -> int:
        for _ in DOMAINS:
            self._next += 1
            domain = DOMAINS[self._next % len(DOMAINS)]
            if domain in self._used:
                continue
            try:
                fcntl.lockf(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB, 1, domain)
            except OSError:
                continue
            self._used.add(domain)
            return domain
        raise RuntimeError('Every ROS domain from 1 to 101 is taken by tests that run now.')
