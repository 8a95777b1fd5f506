"""A short run, recorded as the node records it, without ROS running."""

from __future__ import annotations

from pathlib import Path

import pytest

from cube_sim.node.topics import PUBLISHED
from cube_sim.physics import Settings
from cube_sim.recording import Recorder
from cube_sim.simulation import Simulation, Throwing
from cube_sim.simulation.camera import Camera

SECONDS = 1.0
PERIOD_NS = 20_000_000


class _Recording:
    """An outlet into a bag."""

    def __init__(self, recorder: Recorder) -> None:
        self._recorder = recorder

    def wants(self, topic: str) -> bool:
        return topic not in ('~/markers', '/clock')

    def send(self, topic: str, time_ns: int, message: bytes) -> None:
        self._recorder.write(topic.replace('~', '/cube_sim'), time_ns, message)


def write_bag(path: Path) -> Path:
    """
    Record one second: a throw at the start, one at 0.2 s, and a reset at 0.8 s.

    The camera is turned up at 0.2 s, and the cubes are made larger at 0.4 s.
    """
    topics = [spec.recorded(spec.name.replace('~', '/cube_sim')) for spec in PUBLISHED]
    recorder = Recorder(path, topics, on_error=pytest.fail)
    simulation = Simulation(
        _Recording(recorder), Settings(model='impulse'), Throwing(), camera=Camera(), period=10
    )
    simulation.throw()
    for period in range(round(SECONDS * 1e9 / PERIOD_NS)):
        if period == 10:
            simulation.place_camera((0.0, 0.0, 2.0), (0.0, -0.1, 0.0, 1.0))
            simulation.throw()
        elif period == 20:
            simulation.configure({'cube_size': 0.6})
        elif period == 40:
            simulation.reset()
        simulation.advance()
    recorder.close()
    return path
