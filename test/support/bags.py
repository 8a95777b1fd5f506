"""Bags of runs for tests, made without a node: a simulation whose messages go into a writer."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from cube_sim.messages.poses import pose_array
from cube_sim.physics import Settings
from cube_sim.recording import BagWriter, Topic
from cube_sim.simulation import Scenario, Simulation, Throwing
from cube_sim.simulation.camera import Camera

NAMES = {
    '~/settings': ('rcl_interfaces/msg/ParameterEvent', 'transient_local'),
    '~/throws': ('nav_msgs/msg/Odometry', 'transient_local'),
    '~/resets': ('std_msgs/msg/Header', 'transient_local'),
    '~/poses': ('geometry_msgs/msg/PoseArray', 'volatile'),
}
TOPICS = [
    Topic(name.replace('~', '/cube_sim'), kind, durability=durability)
    for name, (kind, durability) in NAMES.items()
]


class BagOutlet:
    """Writes what a bag needs to be simulated again, leaving out the poses of `gap` (s)."""

    def __init__(self, writer: BagWriter, gap: tuple[float, float] | None = None) -> None:
        self.writer = writer
        self.gap = gap

    def wants(self, topic: str) -> bool:
        return topic in NAMES

    def send(self, topic: str, time_ns: int, message: bytes) -> None:
        if topic not in NAMES:
            return
        if topic == '~/poses' and self.gap and self.gap[0] <= time_ns / 1e9 < self.gap[1]:
            return
        self.writer.write(topic.replace('~', '/cube_sim'), time_ns, message)


def record_run(
    path: Path,
    scenario: str,
    seconds: float,
    *,
    period: int = 10,
    gap: tuple[float, float] | None = None,
    max_cubes: int = 1000,
    **settings: object,
) -> Path:
    """Record a run of that many simulated seconds, poses every `period` steps; return its bag."""
    chosen = Settings(**settings)
    with BagWriter(path, TOPICS) as writer:
        simulation = Simulation(
            BagOutlet(writer, gap),
            chosen,
            Throwing(max_cubes=max_cubes),
            camera=Camera(),
            scenario=Scenario.parse(scenario),
            period=period,
            end=round(seconds * 1e9) // chosen.time_step_ns,
            report=_fail,
        )
        while not simulation.finished:
            simulation.advance()
    return path


def record_poses(
    path: Path, frames: Iterable[tuple[int, np.ndarray]], topic: str = '/mocap/cubes'
) -> Path:
    """Record poses of somebody else: (time in ns, (N, 7)) each."""
    with BagWriter(path, [Topic(topic, 'geometry_msgs/msg/PoseArray')]) as writer:
        for time_ns, poses in frames:
            writer.write(topic, time_ns, pose_array(time_ns, 'map', np.asarray(poses)))
    return path


def drop(height: float = 2.0) -> str:
    """Return the scenario of a cube that is let fall flat, its centre at `height`, m."""
    return (
        f'- {{at: 0.0, camera: {{position: [0, 0, {height}], orientation: [0, 0, 0, 1]}}}}\n'
        '- {at: 0.0, throw: {speed: 0.0, spin: [0, 0, 0]}}\n'
    )


def throws(count: int, seed: int = 1, every: float = 0.05) -> str:
    """Return the scenario of `count` cubes that are thrown in many directions."""
    random = np.random.default_rng(seed)
    lines = []
    for number in range(count):
        at = round(number * every, 6)
        x, y = random.uniform(-2.0, 2.0, 2)
        z = random.uniform(1.5, 4.0)
        turn = random.normal(size=4)
        turn /= np.linalg.norm(turn)
        spin = random.normal(scale=3.0, size=3)
        speed = random.uniform(2.0, 6.0)
        lines.append(
            f'- {{at: {at}, camera: {{position: [{x}, {y}, {z}], '
            f'orientation: [{", ".join(map(repr, map(float, turn)))}]}}}}\n'
            f'- {{at: {at}, throw: {{speed: {speed}, spin: {[float(w) for w in spin]}}}}}\n'
        )
    return ''.join(lines)


def _fail(words: str) -> None:
    raise AssertionError(words)
