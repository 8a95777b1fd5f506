"""
What recording costs: in the simulator's process, beside a subscriber in another one.

Run: python3 benchmarks/recording_cpu.py [CUBES [SECONDS]]. sim_node throws CUBES cubes (1000) and
publishes poses and markers 50 times a second. A peer in another process subscribes to them with
rclpy, raw, and writes them with the Writer of the mcap package. For SECONDS (20) sim_node does not
record, for SECONDS it does. The peer runs all the time, so that the messages are laid out and sent
in both cases; its cost is counted while both record.
"""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path
from typing import Any

import rclpy
from geometry_msgs.msg import PoseArray
from mcap.writer import CompressionType, Writer
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from std_srvs.srv import SetBool
from visualization_msgs.msg import MarkerArray

from cube_sim.recording.definitions import find_definition

TOPICS = {
    '/cube_sim/poses': (PoseArray, 'geometry_msgs/msg/PoseArray'),
    '/cube_sim/markers': (MarkerArray, 'visualization_msgs/msg/MarkerArray'),
    '/clock': (Clock, 'rosgraph_msgs/msg/Clock'),
}
TICKS = os.sysconf('SC_CLK_TCK')


def peer(path: Path) -> None:
    """Record the topics until SIGINT; say 'ready' when messages come."""
    rclpy.init()
    node = rclpy.create_node('peer_recorder')
    counts = dict.fromkeys(TOPICS, 0)
    with path.open('wb') as out:
        writer = Writer(out, compression=CompressionType.NONE)
        writer.start(profile='ros2')

        def subscribe(topic: str, message: Any, type_name: str) -> None:
            schema = writer.register_schema(
                type_name, 'ros2msg', find_definition(type_name).text.encode()
            )
            channel = writer.register_channel(topic, 'cdr', schema)

            def take(data: bytes) -> None:
                now = time.time_ns()
                counts[topic] += 1
                writer.add_message(channel, now, data, now, counts[topic])
                if sum(counts.values()) == 100:
                    print('ready', flush=True)

            qos = QoSProfile(depth=10)
            if topic == '/clock':
                qos.reliability = ReliabilityPolicy.BEST_EFFORT
            node.create_subscription(message, topic, take, qos, raw=True)

        for topic, (message, type_name) in TOPICS.items():
            subscribe(topic, message, type_name)
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        stop = threading.Event()
        signal.signal(signal.SIGINT, lambda *_: stop.set())
        while not stop.is_set():
            executor.spin_once(timeout_sec=0.1)
        writer.finish()
    rclpy.try_shutdown()


def cpu_seconds(process: subprocess.Popen[Any], thread: str = '') -> float:
    """Return the CPU time of a process, or of one of its threads, s."""
    path = Path(f'/proc/{process.pid}') / (f'task/{thread}/stat' if thread else 'stat')
    fields = path.read_text().rsplit(')', 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / TICKS


def threads(process: subprocess.Popen[Any]) -> set[str]:
    """Return the ids of its threads."""
    return {path.name for path in Path(f'/proc/{process.pid}/task').iterdir()}


def record(node: Any, on: bool) -> str:
    """Call ~/record."""
    client = node.create_client(SetBool, '/cube_sim/record')
    if not client.wait_for_service(10.0):
        raise SystemExit('sim_node does not answer')
    future = client.call_async(SetBool.Request(data=on))
    rclpy.spin_until_future_complete(node, future, timeout_sec=60.0)
    return str(future.result().message)


def measure(cubes: int, seconds: float) -> None:
    """Run both and print the table."""
    directory = Path(tempfile.mkdtemp(prefix='cube_sim_cpu_'))
    scenario = directory / 'throws.yaml'
    scenario.write_text('- {at: 0.0, throw: {}}\n' * cubes)
    command = [sys.executable, '-m', 'cube_sim.node.main', '--ros-args']
    for name, value in {
        'scenario': scenario,
        'max_cubes': cubes,
        'bag_directory': directory,
        'record_markers': 'true',
    }.items():
        command += ['-p', f'{name}:={value}']
    environment = {k: v for k, v in os.environ.items() if k != '_ROS_WHEELS_BOOTSTRAP_COMPLETE'}
    rclpy.init()
    node = rclpy.create_node('cpu_watch')
    simulator = subprocess.Popen(command, env=environment)
    other = subprocess.Popen(
        [sys.executable, __file__, '--peer', str(directory / 'peer.mcap')],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
    )
    try:
        assert other.stdout is not None
        if other.stdout.readline() != 'ready\n':
            raise SystemExit('the peer hears nothing')
        time.sleep(2.0)
        before = cpu_seconds(simulator)
        time.sleep(seconds)
        plain = (cpu_seconds(simulator) - before) / seconds
        known = threads(simulator)
        path = record(node, True)
        time.sleep(1.0)
        # rclpy makes no threads for a call, so what is new is the recorder.
        own = threads(simulator) - known
        start = cpu_seconds(simulator), sum(cpu_seconds(simulator, thread) for thread in own)
        peer_start = cpu_seconds(other)
        time.sleep(seconds)
        both = (cpu_seconds(simulator) - start[0]) / seconds
        thread = (sum(cpu_seconds(simulator, one) for one in own) - start[1]) / seconds
        outside = (cpu_seconds(other) - peer_start) / seconds
        record(node, False)
        size = sum(file.stat().st_size for file in Path(path).glob('*.mcap'))
    finally:
        for process in (simulator, other):
            process.send_signal(signal.SIGINT)
            process.wait(60.0)
        shutil.rmtree(directory)
        rclpy.try_shutdown()
    inside = both - plain
    print(
        f'{cubes} cubes with markers at 50 Hz, {size / (seconds + 1.0) / 1e6:.1f} MB/s recorded\n'
    )
    print('| recording | CPU s for each s of simulation | of the peer |')
    print('|---|---|---|')
    print(f'| the recorder in sim_node, its thread ({len(own)}) | {thread:.3f} '
          f'| {thread / outside:.2f} |')  # fmt: skip
    print(f'| sim_node with it, less sim_node without | {inside:.3f} | {inside / outside:.2f} |')
    print(f'| raw rclpy subscriber and mcap Writer in a process | {outside:.3f} | 1 |')
    print(f'| for scale: sim_node without recording | {plain:.3f} | {plain / outside:.2f} |')


def main() -> None:
    """Be the peer, or measure."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    if sys.argv[1:2] == ['--peer']:
        peer(Path(sys.argv[2]))
        return
    cubes = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    measure(cubes, float(sys.argv[2]) if len(sys.argv) > 2 else 20.0)


if __name__ == '__main__':
    main()
