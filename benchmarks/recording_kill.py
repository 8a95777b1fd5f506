"""
What a recording loses when its process is killed at a random moment.

Run: python3 benchmarks/recording_kill.py [KILLS]. For 10, 100 and 1000 cubes, KILLS times (100 if
not given): sim_node records them in real time, all thrown at once, and gets SIGKILL between 0.05
and 3 s after its bag's directory appears. The loss is the simulated time that was reached minus
that of the last pose that can be read from the file. For the former sim_node writes the time of
each publication into memory that it shares with this process, and the clock's time since is added.
"""

from __future__ import annotations

import mmap
import os
import random
import shutil
import statistics
import struct
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import EndOfFile
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

COUNTS = (10, 100, 1000)
PARALLEL = 3  # on two cores: each needs one for a second to start, then a tenth of one
EARLIEST, LATEST = 0.05, 3.0  # s after the directory appears

# sim_node, with the clock's and the simulation's time, ns, of each publication told to PROGRESS.
SIMULATOR = """
import mmap, os, struct, sys, time
from cube_sim.node import main, outlet
progress = mmap.mmap(os.open(os.environ['PROGRESS'], os.O_RDWR), 16)
send = outlet.NodeOutlet.send
def told(self, topic, time_ns, message):
    if topic == '~/poses':
        progress[:] = struct.pack('<QQ', time.monotonic_ns(), time_ns)
    send(self, topic, time_ns, message)
outlet.NodeOutlet.send = told
sys.exit(main.main())
"""


@dataclass
class Kill:
    """One run; times in s."""

    reached: float
    recorded: float
    head: bool  # the file says what it is
    poses: int

    @property
    def loss(self) -> float:
        """Simulated time that is lost."""
        return self.reached - self.recorded


def run(count: int, moment: float, domain: int) -> Kill:
    """Record `count` cubes, kill that after `moment` s, and return what is lost."""
    directory = Path(tempfile.mkdtemp(prefix='cube_sim_kill_'))
    scenario = directory / 'throws.yaml'
    scenario.write_text('- {at: 0.0, throw: {}}\n' * count)
    progress = directory / 'progress'
    progress.write_bytes(bytes(16))
    bags = directory / 'bags'
    command = [sys.executable, '-c', SIMULATOR, '--ros-args']
    for name, value in {
        'scenario': scenario,
        'max_cubes': count,
        'record': 'true',
        'bag_directory': bags,
        'real_time_factor': 1.0,
    }.items():
        command += ['-p', f'{name}:={value}']
    environment = {k: v for k, v in os.environ.items() if k != '_ROS_WHEELS_BOOTSTRAP_COMPLETE'}
    environment.update(ROS_DOMAIN_ID=str(domain), PROGRESS=str(progress))
    process = subprocess.Popen(command, env=environment)
    try:
        deadline = time.monotonic() + 60.0
        while not list(bags.glob('*')):
            if time.monotonic() > deadline or process.poll() is not None:
                raise SystemExit('sim_node makes no bag')
            time.sleep(0.002)
        time.sleep(moment)
    finally:
        process.kill()
        killed_ns = time.monotonic_ns()
        process.wait()
    (bag,) = bags.glob('*')
    with progress.open('rb') as shared:
        wall_ns, sim_ns = struct.unpack('<QQ', mmap.mmap(shared.fileno(), 16, prot=mmap.PROT_READ))
    reached = (sim_ns + max(0, killed_ns - wall_ns)) * 1e-9 if wall_ns else 0.0
    head, times = read(bag / f'{bag.name}_0.mcap')
    shutil.rmtree(directory)
    return Kill(reached, times[-1] if times else 0.0, head, len(times))


def read(path: Path) -> tuple[bool, list[float]]:
    """Return whether the topic is described, and the times of the poses, s."""
    if not path.exists():
        return False, []
    poses = None
    times = []
    with path.open('rb') as stream:
        try:
            for record in StreamReader(stream, validate_crcs=True).records:
                if isinstance(record, Channel) and record.topic == '/cube_sim/poses':
                    poses = record.id
                elif isinstance(record, Message) and record.channel_id == poses:
                    times.append(record.log_time * 1e-9)
        except EndOfFile:
            pass
    return poses is not None, times


def measure(count: int, kills: int, domain: int) -> list[Kill]:
    """Kill that often, some at a time, each in a ROS domain of its own."""
    rng = random.Random(count)
    moments = [rng.uniform(EARLIEST, LATEST) for _ in range(kills)]
    free = list(range(domain, domain + PARALLEL))

    def one(moment: float) -> Kill:
        own = free.pop()
        try:
            return run(count, moment, own)
        finally:
            free.append(own)

    with ThreadPoolExecutor(PARALLEL) as pool:
        return list(pool.map(one, moments))


def row(count: int, kills: list[Kill]) -> list[Any]:
    """Return the figures of a line of the table."""
    losses = [kill.loss for kill in kills]
    return [
        count,
        len(kills),
        f'{max(losses):.3f} s',
        f'{statistics.mean(losses):.3f} s',
        sum(not kill.head for kill in kills),
        sum(not kill.poses for kill in kills),
        sum(not kill.reached for kill in kills),
    ]


def main() -> None:
    """Measure and print the table."""
    kills = int(sys.argv[1]) if len(sys.argv) > 1 else 100
    os.environ.setdefault('ROS_AUTOMATIC_DISCOVERY_RANGE', 'LOCALHOST')
    domain = 1 + os.getpid() % (100 - PARALLEL)
    start = time.monotonic()
    load = os.getloadavg()[0]
    print(f'{PARALLEL} at a time on {os.cpu_count()} cores, load before {load:.1f}\n')
    print(
        '| cubes | kills | largest loss | mean loss | files without a head '
        '| files without a pose | of these, before the first pose |'
    )
    print('|---|---|---|---|---|---|---|')
    for count in COUNTS:
        cells = row(count, measure(count, kills, domain))
        print(f'| {" | ".join(map(str, cells))} |', flush=True)
    print(f'\n{time.monotonic() - start:.0f} s in all')


if __name__ == '__main__':
    main()
