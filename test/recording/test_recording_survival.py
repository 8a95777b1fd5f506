from __future__ import annotations

import random
import subprocess
import sys
import time
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader

import cube_sim
from cube_sim.recording import BagWriter

# A recording as the node makes it, without ROS: one message every 10 ms, dated by the steady
# clock, which is the same in all processes.
RECORDING = """
import sys, threading, time
from pathlib import Path
from cube_sim.recording import Recorder, Topic
size = int(sys.argv[2])
recorder = Recorder(
    Path(sys.argv[1]),
    [Topic('/cube_sim/poses', 'geometry_msgs/msg/PoseArray')],
    on_error=print,
)
pace = threading.Event()
for count in range(100_000):
    recorder.write('/cube_sim/poses', time.monotonic_ns(), bytes(size))
    print(count, flush=True)
    pace.wait(0.01)
"""


def read(path: Path) -> tuple[set[str], list[int]]:
    """Return the topics that are described, and the log times."""
    schemas, topics, times = set(), set(), []
    with path.open('rb') as stream:
        try:
            for record in StreamReader(stream, validate_crcs=True).records:
                if isinstance(record, Schema):
                    schemas.add(record.id)
                elif isinstance(record, Channel):
                    assert record.schema_id in schemas
                    topics.add(record.topic)
                elif isinstance(record, Message):
                    times.append(record.log_time)
        except EndOfFile:
            pass
    return topics, times


@pytest.mark.parametrize('cubes', [10, 100, 1000])
@pytest.mark.parametrize('seed', [1, 2])
def test_a_recording_that_is_killed_loses_less_than_600_ms(tmp_path, cubes, seed):
    messages = random.Random(f'{cubes} {seed}').randrange(2, 100)
    with subprocess.Popen(
        [sys.executable, '-c', RECORDING, str(tmp_path / 'b'), str(56 * cubes)],
        cwd=Path(cube_sim.__file__).parents[1],
        stdout=subprocess.PIPE,
    ) as child:
        for _ in range(messages):
            assert child.stdout.readline().strip().isdigit()
        child.kill()
        killed_ns = time.monotonic_ns()
        child.wait(30)
    topics, times = read(tmp_path / 'b' / 'b_0.mcap')
    assert topics == {'/cube_sim/poses'}
    if times:
        assert killed_ns - times[-1] < 600_000_000
    else:
        assert messages < 60, 'nothing at all after 0.6 s'


def test_a_file_that_was_just_begun_is_never_empty(tmp_path, topics, make):
    seen = []
    original = Path.rename

    def rename(path: Path, target: Path) -> Path:
        seen.append((path.name, path.stat().st_size, Path(target).exists()))
        return original(path, target)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, 'rename', rename)
        bag = BagWriter(tmp_path / 'b', topics)
    assert seen == [('b_0.mcap.part', (tmp_path / 'b' / 'b_0.mcap').stat().st_size, False)]
    assert seen[0][1] > 1000
    bag.close()
