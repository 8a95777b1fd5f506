"""The fixtures of ROS, and a terminal, for this folder."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from node.ros_fixtures import *  # noqa: F403
from teleop.teleop_pty import TeleopTerminal


@pytest.fixture
def ros_range() -> str:
    """The program in the terminal is a process of its own."""
    return 'LOCALHOST'


@pytest.fixture
def teleop(ros_domain: int, tmp_path: Path) -> Iterator[Callable[..., TeleopTerminal]]:
    """Start teleop_key with these arguments in a terminal of its own; what runs still is ended."""
    running: list[TeleopTerminal] = []

    def start(*arguments: str, columns: int = 80, rows: int = 24) -> TeleopTerminal:
        running.append(TeleopTerminal(tmp_path, arguments, columns, rows))
        return running[-1]

    yield start
    for terminal in running:
        terminal.close()
