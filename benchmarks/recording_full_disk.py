"""
What a full disk does to a run that is recorded, and what comes back with the space.

Run: python3 benchmarks/recording_full_disk.py [DIRECTORY]. sim_node records 1000 cubes with
markers, 14 MB/s, into DIRECTORY on a small file system (if none is given: a tmpfs of 700 MB, which
needs root). It is filled up and stays so for 30 s, longer than the recorder's queue lasts; then
what filled it beside the bag is removed. The table shows the real-time factor before, during and
after, from the stamps of ~/poses; below it stands what the bag says that it lacks.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import rclpy
import yaml
from geometry_msgs.msg import PoseArray
from mcap.reader import make_reader
from rclpy.executors import SingleThreadedExecutor

CUBES = 1000
ROOM = 8.0
FULL = 30.0


class Pace:
    """The real-time factor, by the stamps that arrive."""

    def __init__(self) -> None:
        """Wait for messages."""
        self.last: tuple[float, float] | None = None
        self.arrived = threading.Event()

    def take(self, message: bytes) -> None:
        """Note a raw PoseArray."""
        seconds = int.from_bytes(message[4:8], 'little')
        nanoseconds = int.from_bytes(message[8:12], 'little')
        self.last = (time.monotonic(), seconds + nanoseconds * 1e-9)
        self.arrived.set()

    def over(self, seconds: float) -> tuple[float, float, float]:
        """Return factor, first and last stamp of that time."""
        first = self.now()
        time.sleep(seconds)
        last = self.now()
        return (last[1] - first[1]) / (last[0] - first[0]), first[1], last[1]

    def now(self) -> tuple[float, float]:
        """Return arrival and stamp of the next message."""
        self.arrived.clear()
        if not self.arrived.wait(60.0) or self.last is None:
            raise SystemExit('no poses arrive')
        return self.last


def fill(ballast: Path) -> None:
    """Take all the room that is left."""
    with ballast.open('ab', buffering=0) as out:
        for size in (1 << 20, 1 << 12, 1):
            try:
                while True:
                    out.write(bytes(size))
            except OSError:
                continue


def measure(disk: Path) -> None:
    """Run it and print the table."""
    scenario = Path(tempfile.mkdtemp(prefix='cube_sim_full_')) / 'throws.yaml'
    scenario.write_text('- {at: 0.0, throw: {}}\n' * CUBES)
    ballast = disk / 'ballast'
    half = shutil.disk_usage(disk).free // 2
    ballast.write_bytes(bytes(half))
    command = [sys.executable, '-m', 'cube_sim.node.main', '--ros-args']
    for name, value in {
        'scenario': scenario,
        'max_cubes': CUBES,
        'record': 'true',
        'record_markers': 'true',
        'bag_directory': disk,
    }.items():
        command += ['-p', f'{name}:={value}']
    environment = {k: v for k, v in os.environ.items() if k != '_ROS_WHEELS_BOOTSTRAP_COMPLETE'}
    rclpy.init()
    node = rclpy.create_node('full_disk_watch')
    pace = Pace()
    node.create_subscription(PoseArray, '/cube_sim/poses', pace.take, 10, raw=True)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    spinning = threading.Thread(target=executor.spin, daemon=True)
    spinning.start()
    simulator = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True)
    try:
        pace.now()
        time.sleep(2.0)  # what the throws delayed is made up
        rows = [('room', *pace.over(ROOM))]
        fill(ballast)
        rows.append(('full', *pace.over(FULL)))
        ballast.unlink()
        rows.append(('room again', *pace.over(ROOM)))
    finally:
        simulator.send_signal(signal.SIGINT)
        _, said = simulator.communicate(timeout=60.0)
        executor.shutdown()
        spinning.join(5.0)
        rclpy.try_shutdown()
        shutil.rmtree(scenario.parent)
    print('| disk | real-time factor | simulated time |')
    print('|---|---|---|')
    for name, factor, first, last in rows:
        print(f'| {name} | {factor:.3f} | {first:.2f} … {last:.2f} s |')
    print(f'\nsim_node said, and exited with {simulator.returncode}:\n\n{said}')
    for bag in disk.glob('*/metadata.yaml'):
        describe(bag)


def describe(metadata: Path) -> None:
    """Print what the bag holds and lacks, and check every file of it."""
    information = yaml.safe_load(metadata.read_text())['rosbag2_bagfile_information']
    for file in information['files']:
        with (metadata.parent / file['path']).open('rb') as stream:
            messages = sum(1 for _ in make_reader(stream, validate_crcs=True).iter_messages())
        start = file['starting_time']['nanoseconds_since_epoch'] / 1e9
        end = start + file['duration']['nanoseconds'] / 1e9
        print(f'{file["path"]}: {messages} messages, {start:.2f} … {end:.2f} s')
    custom = information['custom_data']
    print(f'drops: {custom["drops"]}, resumed: {custom.get("resumed", 0)}')
    for first, last, count in json.loads(custom.get('gaps', '[]')):
        print(f'gap: {first / 1e9:.2f} … {last / 1e9:.2f} s, {count} messages')


def main() -> None:
    """Find a small disk and measure."""
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    os.environ.setdefault('ROS_DOMAIN_ID', str(1 + os.getpid() % 100))
    if len(sys.argv) > 1:
        measure(Path(sys.argv[1]))
        return
    disk = Path(tempfile.mkdtemp(prefix='cube_sim_disk_'))
    subprocess.run(['mount', '-t', 'tmpfs', '-o', 'size=700m', 'tmpfs', disk], check=True)
    try:
        measure(disk)
    finally:
        subprocess.run(['umount', disk], check=True)
        disk.rmdir()


if __name__ == '__main__':
    main()
