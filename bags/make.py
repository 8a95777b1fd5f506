"""
Record the bags of this directory anew: `python3 bags/make.py [NAME ...]`.

Each is a run of sim_node, as fast as it can, on a private domain; the scenario lies beside it. An
existing bag is not overwritten: remove it first.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).parent

# Name of the bag -> scenario, and what else the node is told.
BAGS: dict[str, tuple[str, dict[str, str]]] = {
    'simple': ('throws.yaml', {'physics_model': 'simple'}),
    'impulse': ('throws.yaml', {'physics_model': 'impulse'}),
    'contact': ('throws.yaml', {'physics_model': 'contact'}),
    'switch': ('switch.yaml', {}),
    'reset': ('reset.yaml', {'physics_model': 'impulse', 'record_markers': 'true'}),
    'killed': ('throws.yaml', {'physics_model': 'impulse', 'real_time_factor': '1.0'}),
}

COMMON = {'real_time_factor': '0.0', 'duration': '4.0', 'bag_compression': 'zstd'}

# How much the killed one has recorded when it is killed, bytes.
KILLED_AT = 100_000


def main() -> int:
    """Record the bags that are named, or all."""
    for name in sys.argv[1:] or BAGS:
        scenario, own = BAGS[name]
        parameters = {
            **COMMON,
            'scenario': str(HERE / scenario),
            'record': 'true',
            'bag_directory': str(HERE),
            'bag_name': name,
            **own,
        }
        command = [sys.executable, '-m', 'cube_sim.node.main', '--ros-args']
        for key, value in parameters.items():
            command += ['-p', f'{key}:={value}']
        environment = {k: v for k, v in os.environ.items() if not k.startswith('_ROS_WHEELS')}
        environment['ROS_AUTOMATIC_DISCOVERY_RANGE'] = 'OFF'
        with tempfile.TemporaryDirectory() as log:
            process = subprocess.Popen(command, env={**environment, 'ROS_LOG_DIR': log})
            if name == 'killed':
                kill(process, HERE / name / f'{name}_0.mcap')
            elif process.wait() != 0:
                return process.returncode
    return 0


def kill(process: subprocess.Popen[bytes], file: Path) -> None:
    """Kill the process once its bag has grown, as a power cut would."""
    while process.poll() is None and not (file.exists() and file.stat().st_size > KILLED_AT):
        time.sleep(0.02)
    process.send_signal(signal.SIGKILL)
    process.wait()


if __name__ == '__main__':
    sys.exit(main())
