"""
Time to read a bag of poses into arrays: cube_sim beside rosbags, same bag, same process.

Run: python3 benchmarks/decoding.py [MESSAGES] [CUBES]. Both open the bag, read every message and
decode it; the two take turns, and the quickest of five rounds counts. The bag is in the page
cache, so this is the readers' own time. The values of both are compared too.
"""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from rosbags.highlevel import AnyReader

from cube_sim.messages.decode import PoseArrayDecoder, PoseArrayView
from cube_sim.messages.poses import pose_array
from cube_sim.recording import BagWriter, Topic
from cube_sim.recording.compression import Compression
from cube_sim.recording.reader import BagReader

TOPIC = Topic('/cube_sim/poses', 'geometry_msgs/msg/PoseArray')
ROUNDS = 5
STEP_NS = 20_000_000
COMPRESSIONS: tuple[Compression, ...] = ('none', 'lz4', 'zstd')


def main() -> None:
    """Measure and print the table."""
    messages = int(sys.argv[1]) if len(sys.argv) > 1 else 10_000
    cubes = int(sys.argv[2]) if len(sys.argv) > 2 else 100
    print(f'{messages} PoseArrays of {cubes} cubes')
    print('| chunks | cube_sim, reading alone | cube_sim | rosbags | ratio |')
    print('|---|---|---|---|---|')
    with tempfile.TemporaryDirectory() as folder:
        for compression in COMPRESSIONS:
            bag = Path(folder, compression)
            write(bag, messages, cubes, compression)
            times: dict[str, list[float]] = {'read': [], 'ours': [], 'theirs': []}
            for _ in range(ROUNDS):
                for name, run in (('read', read), ('ours', ours), ('theirs', theirs)):
                    start = time.perf_counter()
                    found = run(bag)
                    times[name].append(time.perf_counter() - start)
                    assert found == messages
            check(bag)
            reading, own, other = (min(times[name]) for name in ('read', 'ours', 'theirs'))
            print(
                f'| {compression} | {reading:.3f} s | {own:.3f} s | {other:.3f} s '
                f'| {other / own:.1f} |'
            )


def write(bag: Path, messages: int, cubes: int, compression: Compression) -> None:
    """Record cubes that move."""
    start = np.random.default_rng(1).normal(size=(cubes, 7))
    with BagWriter(bag, [TOPIC], compression=compression) as writer:
        for number in range(messages):
            poses = start + 0.001 * number
            writer.write(TOPIC.name, number * STEP_NS, pose_array(number * STEP_NS, 'world', poses))


def read(bag: Path) -> int:
    """Read all messages and decode none."""
    with BagReader(bag) as reader:
        return sum(1 for _ in reader.messages())


def ours(bag: Path) -> int:
    """Read all messages into arrays."""
    decoder = PoseArrayDecoder()
    count = 0
    with BagReader(bag) as reader:
        for message in reader.messages([TOPIC.name]):
            decoder(message.data)
            count += 1
    return count


def theirs(bag: Path) -> int:
    """Do the same with rosbags, into its own message objects."""
    count = 0
    with AnyReader([bag]) as reader:
        for link, _, data in reader.messages():
            reader.deserialize(data, link.msgtype)
            count += 1
    return count


def check(bag: Path) -> None:
    """Compare the values of some messages."""
    decoder = PoseArrayDecoder()
    with BagReader(bag) as reader, AnyReader([bag]) as other:
        pairs = zip(reader.messages(), other.messages(), strict=True)
        for number, (message, (link, time_ns, data)) in enumerate(pairs):
            if number % 97 == 0:
                same(decoder(message.data), other.deserialize(data, link.msgtype))
                assert message.time_ns == time_ns


def same(view: PoseArrayView, message: object) -> None:
    """Fail unless both are the same poses."""
    rows = [
        [*(getattr(pose.position, axis) for axis in 'xyz'),
         *(getattr(pose.orientation, axis) for axis in 'xyzw')]
        for pose in message.poses  # type: ignore[attr-defined]
    ]  # fmt: skip
    assert np.array_equal(view.poses, rows)


if __name__ == '__main__':
    main()
