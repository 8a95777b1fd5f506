"""
How many cubes sim_node simulates, publishes and records in real time.

Run: python3 benchmarks/scale.py [CUBES ...]. For each number: sim_node at its defaults (steps of
2 ms, 50 publications a second, model impulse) with one subscriber of ~/poses in another process,
without and with recording. The real-time factor is that of the stamps that arrive there against
the clock; the shares of a CPU are those of /diagnostics and of the process.
"""

from __future__ import annotations

import os
import random
import shutil
import signal
import statistics
import struct
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

COUNTS = tuple(range(1000, 10_001, 1000))

# How long each run is watched, s, after all cubes are there.
WATCHED = 5.0


class Watch:
    """Stamps and arrivals of ~/poses, and the figures of /diagnostics."""

    def __init__(self, node: Node) -> None:
        """Subscribe."""
        self.arrivals: list[tuple[float, float]] = []
        self.shares: list[tuple[float, float]] = []
        self.cubes = 0
        self.drops = 0
        self.changed = threading.Condition()
        node.create_subscription(PoseArray, '/cube_sim/poses', self._poses, 10, raw=True)
        node.create_subscription(DiagnosticArray, '/diagnostics', self._diagnostics, 10)

    def clear(self) -> None:
        """Begin anew."""
        with self.changed:
            self.arrivals.clear()
            self.shares.clear()

    def _poses(self, message: bytes) -> None:
        # After the encapsulation: seconds, nanoseconds, frame "world" in 12 bytes, the count.
        seconds, nanoseconds, count = struct.unpack_from('<iI12xI', message, 4)
        with self.changed:
            self.cubes = count
            self.arrivals.append((time.monotonic(), seconds + nanoseconds * 1e-9))
            self.changed.notify()

    def _diagnostics(self, message: DiagnosticArray) -> None:
        values: dict[str, str] = {}
        for status in message.status:
            values.update({item.key: item.value for item in status.values})
        with self.changed:
            self.shares.append(tuple(_percent(values, of) for of in ('physics', 'messages')))
            self.drops = int(values.get('drops', 0))


def _percent(values: dict[str, str], part: str) -> float:
    return float(values[f'{part} share of a CPU'].rstrip(' %'))


def scenario(count: int) -> str:
    """Return `count` throws at time 0, each in a direction of its own."""
    rng = random.Random(count)
    lines = ['- {at: 0.0, set: {physics_model: impulse}}']
    for _ in range(count):
        turn = ', '.join(f'{rng.gauss(0.0, 1.0):.3f}' for _ in range(4))
        lines.append(f'- {{at: 0.0, camera: {{orientation: [{turn}]}}}}')
        lines.append(f'- {{at: 0.0, throw: {{speed: {rng.uniform(2.0, 12.0):.3f}}}}}')
    return '\n'.join(lines)


def measure(count: int, *, record: bool, watch: Watch) -> dict[str, Any]:
    """Run sim_node with `count` cubes and return its figures."""
    directory = Path(tempfile.mkdtemp(prefix='cube_sim_scale_'))
    file = directory / 'throws.yaml'
    file.write_text(scenario(count))
    parameters = {
        'scenario': file,
        'max_cubes': count,
        'record': str(record).lower(),
        'bag_directory': directory,
    }
    command = [sys.executable, '-m', 'cube_sim.node.main', '--ros-args']
    for name, value in parameters.items():
        command += ['-p', f'{name}:={value}']
    environment = {k: v for k, v in os.environ.items() if k != '_ROS_WHEELS_BOOTSTRAP_COMPLETE'}
    watch.cubes = 0
    process = subprocess.Popen(command, env=environment)
    try:
        with watch.changed:
            if not watch.changed.wait_for(lambda: watch.cubes == count, 60.0):
                raise SystemExit(f'{count} cubes did not come')
        time.sleep(2.0)  # what the throws themselves delayed is made up or given up
        watch.clear()
        cpu, start = _cpu_seconds(process.pid), time.monotonic()
        time.sleep(WATCHED)
        cpu, elapsed = _cpu_seconds(process.pid) - cpu, time.monotonic() - start
        with watch.changed:
            arrivals, shares = list(watch.arrivals), list(watch.shares)
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(60.0)
        size = sum(bag.stat().st_size for bag in directory.glob('*/*.mcap'))
        shutil.rmtree(directory)
    (first_wall, first_sim), (last_wall, last_sim) = arrivals[0], arrivals[-1]
    expected = round((last_sim - first_sim) * 50) + 1
    return {
        'factor': (last_sim - first_sim) / (last_wall - first_wall),
        'arrived': len(arrivals) / expected,
        'physics': statistics.mean(share[0] for share in shares),
        'messages': statistics.mean(share[1] for share in shares),
        'process': 100.0 * cpu / elapsed,
        'drops': watch.drops,
        'megabytes': size / 1e6,
    }


def _cpu_seconds(pid: int) -> float:
    fields = Path(f'/proc/{pid}/stat').read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf('SC_CLK_TCK')


def main() -> None:
    """Measure and print the table."""
    counts = [int(argument) for argument in sys.argv[1:]] or COUNTS
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    rclpy.init()
    node = Node('scale_watch')
    watch = Watch(node)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin)
    spinning.start()
    print(
        '| cubes | real-time factor | poses that arrived | physics | messages | process '
        '| factor recording | process recording | recording | drops |'
    )
    print('|---|---|---|---|---|---|---|---|---|---|')
    for count in counts:
        plain = measure(count, record=False, watch=watch)
        taped = measure(count, record=True, watch=watch)
        print(
            f'| {count} | {plain["factor"]:.3f} | {100 * plain["arrived"]:.1f} % '
            f'| {plain["physics"]:.1f} % | {plain["messages"]:.1f} % | {plain["process"]:.0f} % '
            f'| {taped["factor"]:.3f} | {taped["process"]:.0f} % '
            f'| {taped["process"] - plain["process"]:+.0f} % | {taped["drops"]} |',
            flush=True,
        )
    executor.shutdown()
    spinning.join()
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == '__main__':
    main()
