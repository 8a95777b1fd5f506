"""
Fixtures for tests that need ROS running.

A conftest.py that imports them all (`from node.ros_fixtures import *`) has:

    ros          RosSession: listen, publisher, call, set … on a domain of its own
    sim          make a SimNode in that context: sim(restitution=0.2)
    sim_process  start sim_node as a process on the same domain: sim_process('-p', 'record:=true')
    run_module   start any module of the project as a process on the same domain
    ros_domain   the domain itself, its environment set for this process and its children
    ros_range    ROS_AUTOMATIC_DISCOVERY_RANGE of the test
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from node.ros_domains import Domains
from node.ros_process import RosProcess, remove_unused
from node.ros_session import RosSession, Spinning
from rclpy.parameter import Parameter

from cube_sim.node.node import SimNode

__all__ = [
    'ros',
    'ros_domain',
    'ros_domains',
    'ros_processes',
    'ros_range',
    'run_module',
    'sim',
    'sim_process',
]


@pytest.fixture(scope='session')
def ros_domains() -> Domains:
    """Hands out domains that no other run of the tests has."""
    return Domains()


@pytest.fixture
def ros_range(request: pytest.FixtureRequest) -> str:
    """
    How far ROS looks for others: on this machine when the test starts processes, else nowhere.

    A test with several contexts in this process overrides it with LOCALHOST.
    """
    return 'LOCALHOST' if 'run_module' in request.fixturenames else 'OFF'


@pytest.fixture
def ros_processes() -> Iterator[list[RosProcess]]:
    """What `run_module` has started; torn down last, when nothing holds its shared memory."""
    started: list[RosProcess] = []
    yield started
    remove_unused(set().union(*(process.left_behind for process in started)))


@pytest.fixture
def ros_domain(
    ros_processes: list[RosProcess],
    ros_domains: Domains,
    ros_range: str,
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
) -> Iterator[int]:
    """A domain of the test's own, in the environment too; logs go to the test's directory."""
    with ros_domains.one() as domain:
        monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
        monkeypatch.setenv('ROS_AUTOMATIC_DISCOVERY_RANGE', ros_range)
        monkeypatch.setenv('ROS_LOG_DIR', str(tmp_path / 'log'))
        for name in ('ROS_STATIC_PEERS', 'RMW_IMPLEMENTATION', 'FASTDDS_BUILTIN_TRANSPORTS'):
            monkeypatch.delenv(name, raising=False)
        yield domain


@pytest.fixture
def ros(ros_domain: int) -> Iterator[RosSession]:
    session = RosSession(ros_domain)
    yield session
    session.close()


@pytest.fixture
def sim(ros: RosSession, tmp_path: Path) -> Iterator[Callable[..., SimNode]]:
    """
    Make a SimNode, served on a thread of its own until the test ends.

    Parameters come as keywords, those with a dot in a dict before; bags go to the test's
    directory unless it is told otherwise. `options` are those of SimNode.
    """
    running: list[Spinning] = []

    def make(
        dotted: dict[str, Any] | None = None,
        *,
        options: dict[str, Any] | None = None,
        **parameters: Any,
    ) -> SimNode:
        given = {'bag_directory': str(tmp_path / 'bags'), **parameters, **(dotted or {})}
        node = SimNode(
            context=ros.context,
            use_global_arguments=False,
            parameter_overrides=[Parameter(name, value=value) for name, value in given.items()],
            **(options or {}),
        )
        running.append(Spinning(node))
        return node

    yield make
    for spinning in running:
        spinning.node.close()
        spinning.close()


@pytest.fixture
def run_module(
    ros_processes: list[RosProcess], ros_domain: int, tmp_path: Path
) -> Iterator[Callable[..., RosProcess]]:
    """Start `python -m MODULE ARGUMENTS` in the test's directory; what still runs is ended."""

    def start(module: str, *arguments: str) -> RosProcess:
        ros_processes.append(RosProcess(ros_domain, tmp_path, module, arguments))
        return ros_processes[-1]

    yield start
    for process in ros_processes:
        process.close()


@pytest.fixture
def sim_process(run_module: Callable[..., RosProcess]) -> Callable[..., RosProcess]:
    """Start sim_node with these arguments behind --ros-args."""
    return lambda *arguments: run_module('cube_sim.node.main', '--ros-args', *arguments)
