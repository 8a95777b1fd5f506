"""
Time from process start to the first message on the wire: sim_node beside a bare rclpy node.

Run: python3 benchmarks/startup.py [RUNS]. The two take turns; each message is timed where it
arrives, in a subscriber that was there before. Discovery between two processes takes either
almost no time or two to three seconds, at random and for both alike: the table shows the quickest
and the median of the runs without that wait, and how many there were.
"""

from __future__ import annotations

import os
import signal
import statistics
import subprocess
import sys
import threading
import time

import rclpy
from geometry_msgs.msg import PoseArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

BARE = """
import rclpy
from geometry_msgs.msg import PoseArray
from rclpy.node import Node
rclpy.init()
node = Node('bare')
publisher = node.create_publisher(PoseArray, '/cube_sim/poses', 10)
node.create_timer(0.02, lambda: publisher.publish(PoseArray()))
try:
    rclpy.spin(node)
except Exception:
    pass
"""
SIM = [
    sys.executable,
    '-m',
    'cube_sim.node.main',
    '--ros-args',
    '-p',
    'scenario:=first_throws',
]

# A start slower than this has waited for discovery, s.
WITHOUT_WAIT = 1.9


def main() -> None:
    """Measure and print the table."""
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    rclpy.init()
    arrived = threading.Event()
    node = Node('stop_watch')
    node.create_subscription(PoseArray, '/cube_sim/poses', lambda _: arrived.set(), 10, raw=True)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin)
    spinning.start()
    commands = {'bare rclpy node': [sys.executable, '-c', BARE], 'sim_node': SIM}
    times: dict[str, list[float]] = {name: [] for name in commands}
    for run in range(runs + 1):
        for name, command in commands.items():
            taken = first_message(command, arrived)
            if run:  # the first fills the caches
                times[name].append(taken)
    table(times)
    executor.shutdown()
    spinning.join()
    node.destroy_node()
    rclpy.try_shutdown()


def first_message(command: list[str], arrived: threading.Event) -> float:
    """Start `command`; return the seconds until its first message came."""
    arrived.clear()
    environment = {k: v for k, v in os.environ.items() if k != '_ROS_WHEELS_BOOTSTRAP_COMPLETE'}
    start = time.monotonic()
    process = subprocess.Popen(command, env=environment)
    if not arrived.wait(30.0):
        raise SystemExit(f'no message from {command}')
    taken = time.monotonic() - start
    process.send_signal(signal.SIGTERM)
    process.wait(30.0)
    # What it still sent must not count for the next one.
    time.sleep(0.3)
    return taken


def table(times: dict[str, list[float]]) -> None:
    """Print the figures."""
    quick = {name: [t for t in all_of if t < WITHOUT_WAIT] for name, all_of in times.items()}
    print('| node | runs | without discovery wait | quickest | median of those |')
    print('|---|---|---|---|---|')
    for name, all_of in times.items():
        print(
            f'| {name} | {len(all_of)} | {len(quick[name])} '
            f'| {min(quick[name]):.3f} s | {statistics.median(quick[name]):.3f} s |'
        )
    bare, sim = (quick[name] for name in ('bare rclpy node', 'sim_node'))
    print(
        f'ratio: quickest {min(sim) / min(bare):.2f}, '
        f'median {statistics.median(sim) / statistics.median(bare):.2f} (to stay below 2.0)'
    )


if __name__ == '__main__':
    main()
