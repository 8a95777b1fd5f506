"""What a recording does when its disk is slow, full or gone, and when that is mended."""

from __future__ import annotations

import errno
import json
import os
import queue
import resource
import shutil
import threading
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Metadata
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from cube_sim.recording import BagWriter, Recorder, RecordingError
from cube_sim.recording.mcap_file import McapFile

DEADLINE = 30.0
STEP_NS = 20_000_000


class Disk:
    """Stands before each write: lets it through, stalls it, or is full."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.full = False
        self.free = threading.Event()
        self.free.set()
        self.reached = threading.Event()
        self.written = threading.Semaphore(0)
        write = McapFile._write

        def through(file: McapFile, *parts: bytes) -> None:
            self.reached.set()
            assert self.free.wait(DEADLINE)
            if self.full:
                file._out.seek(file._end)
                file._out.write(parts[0][: len(parts[0]) // 2])
                file._out.truncate(file._end)
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
            write(file, *parts)
            self.written.release()

        monkeypatch.setattr(McapFile, '_write', through)

    def stall(self) -> None:
        self.reached.clear()
        self.free.clear()


class Told:
    """Collects what a recorder says."""

    def __init__(self) -> None:
        self.errors: queue.Queue[str] = queue.Queue()
        self.notices: queue.Queue[str] = queue.Queue()


@pytest.fixture
def disk(monkeypatch) -> Disk:
    return Disk(monkeypatch)


@pytest.fixture
def told() -> Told:
    return Told()


@pytest.fixture
def start(tmp_path, topics, told, disk) -> Any:
    def start(**options: Any) -> Recorder:
        defaults = {'flush_period': 0.0, 'retry_period': 0.01}
        recorder = Recorder(
            tmp_path / 'b',
            topics,
            on_error=told.errors.put,
            on_notice=told.notices.put,
            **{**defaults, **options},
        )
        assert disk.written.acquire(timeout=DEADLINE), 'the head of the file'
        return recorder

    return start


def custom_data(path: Path) -> dict[str, str]:
    text = (path / 'metadata.yaml').read_text()
    return yaml.safe_load(text)['rosbag2_bagfile_information']['custom_data']


def positions(path: Path) -> list[float]:
    """Return the first cube's x in each message, the same by two readers."""
    with AnyReader([path]) as reader:
        one = [
            reader.deserialize(data, link.msgtype).poses[0].position.x
            for link, _, data in reader.messages()
        ]
    two = []
    for number in range(len(list(path.glob('*.mcap')))):
        with (path / f'{path.name}_{number}.mcap').open('rb') as stream:
            reader = make_reader(stream, True, [DecoderFactory()])
            two += [row.poses[0].position.x for *_, row in reader.iter_decoded_messages()]
    assert one == two
    return one


def test_a_disk_that_stalls_again_and_again_loses_nothing(start, told, disk, make, read_bag):
    recorder = start()
    written = []
    for _ in range(4):
        disk.stall()
        # Nothing is written before the disk is freed, so a call that waited would end the test.
        for _ in range(50):
            time_ns = len(written) * STEP_NS
            written.append(('/cube_sim/poses', time_ns, make.poses(time_ns, 100)))
            assert recorder.write(*written[-1])
        assert disk.reached.wait(DEADLINE)
        disk.free.set()
    assert read_bag(recorder.close(DEADLINE)) == written
    assert (recorder.drops, recorder.error, recorder.files) == (0, None, 1)
    assert told.errors.empty()
    assert told.notices.empty()


def test_a_disk_that_is_too_slow_is_told_once_a_gap_and_the_bag_knows(
    start, told, disk, make, read_bag
):
    recorder = start(queue_bytes=20_000)
    disk.stall()
    assert recorder.write('/clock', 0, make.clock(0))
    assert disk.reached.wait(DEADLINE)
    written = 1
    dropped = []
    while len(dropped) < 100:
        if not recorder.write('/clock', written * STEP_NS, make.clock(written)):
            dropped.append(written * STEP_NS)
        written += 1
    assert recorder.write('/cube_sim/resets', written * STEP_NS, make.reset(5)), 'has its own room'
    disk.free.set()
    notice = told.notices.get(timeout=DEADLINE)
    assert f'messages from {dropped[0] / 1e9:.3f} s of simulation time' in notice
    path = recorder.close(DEADLINE)
    assert told.errors.empty()
    assert told.notices.empty()
    times = [time_ns for name, time_ns, _ in read_bag(path) if name == '/clock']
    assert sorted([*times, *dropped]) == [index * STEP_NS for index in range(written)]
    found = custom_data(path)
    assert found['drops'] == '100'
    assert json.loads(found['gaps']) == [[dropped[0], dropped[-1], 100]]
    assert json.loads(found['drops_by_topic']) == {'/clock': 100}


def test_a_full_disk_stops_the_recording_until_there_is_room_and_nothing_is_lost(
    start, told, disk, make
):
    recorder = start()

    def write(first: int, last: int) -> None:
        for step in range(first, last):
            assert recorder.write('/cube_sim/poses', step * STEP_NS, make.poses(step * 2**30, 5))

    write(0, 50)
    assert disk.written.acquire(timeout=DEADLINE)
    disk.full = True
    write(50, 100)
    error = told.errors.get(timeout=DEADLINE)
    assert recorder.error == error
    assert 'No space left on device' in error
    disk.full = False
    notice = told.notices.get(timeout=DEADLINE)
    assert f'goes on in {recorder.path / "b_1.mcap"}' in notice
    assert '0 messages are lost' in notice
    assert recorder.error is None
    write(100, 150)
    path = recorder.close(DEADLINE)
    assert positions(path) == [step * 2**30 * 1e-9 for step in range(150)]
    assert (recorder.files, recorder.resumed, recorder.drops, recorder.error) == (2, 1, 0, None)
    assert sorted(entry.name for entry in path.iterdir()) == [
        'b_0.mcap',
        'b_1.mcap',
        'metadata.yaml',
    ]
    assert custom_data(path) == {'drops': '0', 'resumed': '1'}
    assert told.errors.empty()
    assert told.notices.empty()


def test_what_a_long_full_disk_costs_is_named_even_in_a_file_that_is_then_killed(
    start, told, disk, make, read_bag
):
    recorder = start(queue_bytes=50_000)
    assert recorder.write('/clock', 0, make.clock(0))
    assert disk.written.acquire(timeout=DEADLINE)
    disk.full = True
    assert recorder.write('/clock', 1, make.clock(1))
    told.errors.get(timeout=DEADLINE)
    written = 2
    dropped = []
    while len(dropped) < 500:
        if not recorder.write('/clock', written * STEP_NS, make.clock(written)):
            dropped.append(written * STEP_NS)
        written += 1
    disk.full = False
    assert '500 messages are lost' in told.notices.get(timeout=DEADLINE)
    gaps = f'[[{dropped[0]}, {dropped[-1]}, 500]]'
    while disk.written.acquire(blocking=False):
        pass
    recorder.write('/clock', written * STEP_NS, make.clock(written))
    found: list[dict[str, str]] = []
    while not found:
        assert disk.written.acquire(timeout=DEADLINE)
        found = notes_of_unfinished(recorder.path / 'b_1.mcap')
    assert (found[-1]['drops'], found[-1]['gaps']) == ('500', gaps)
    path = recorder.close(DEADLINE)
    assert (custom_data(path)['drops'], custom_data(path)['gaps']) == ('500', gaps)
    assert len(read_bag(path)) == written + 1 - 500 == recorder.messages


def notes_of_unfinished(path: Path) -> list[dict[str, str]]:
    found = []
    with path.open('rb') as stream:
        try:
            for record in StreamReader(stream).records:
                if isinstance(record, Metadata) and record.name == 'cube_sim':
                    found.append(record.metadata)
        except EndOfFile:
            pass
    return found


def test_a_directory_that_is_deleted_is_made_again_and_the_bag_says_what_is_gone(
    start, told, disk, make, read_bag
):
    recorder = start()
    for time_ns in range(10):
        recorder.write('/clock', time_ns, make.clock(time_ns))
        assert disk.written.acquire(timeout=DEADLINE)
    shutil.rmtree(recorder.path)
    recorder.write('/clock', 10, make.clock(10))
    assert 'b_0.mcap is no longer there' in told.errors.get(timeout=DEADLINE)
    notice = told.notices.get(timeout=DEADLINE)
    assert '10 messages are lost' in notice
    recorder.write('/clock', 11, make.clock(11))
    path = recorder.close(DEADLINE)
    assert [time_ns for _, time_ns, _ in read_bag(path)] == [10, 11]
    assert custom_data(path) == {
        'drops': '10',
        'gaps': '[[0, 9, 10]]',
        'drops_by_topic': '{"/clock": 10}',
        'resumed': '1',
        'gone': '["b_0.mcap"]',
    }
    assert (recorder.messages, recorder.drops) == (2, 10)


def test_a_directory_that_is_moved_away_takes_a_whole_file_with_it(
    start, told, disk, make, read_bag, tmp_path
):
    recorder = start()
    recorder.write('/clock', 0, make.clock(0))
    assert disk.written.acquire(timeout=DEADLINE)
    recorder.path.rename(tmp_path / 'moved')
    recorder.write('/clock', 1, make.clock(1))
    told.notices.get(timeout=DEADLINE)
    assert [time_ns for _, time_ns, _ in read_bag(recorder.close(DEADLINE))] == [1]
    with (tmp_path / 'moved' / 'b_0.mcap').open('rb') as stream:
        assert [row.log_time for *_, row in make_reader(stream).iter_messages()] == [0]


def test_a_limit_for_the_size_of_files_only_makes_more_files(start, told, make, read_bag):
    # What FAT does at 4 GiB. Each file gives up a chunk of 1 MiB for its index.
    data = make.poses(0, 300)
    recorder = start(retry_period=0.0)
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (3_000_000, hard))
    try:
        for time_ns in range(500):
            assert recorder.write('/cube_sim/poses', time_ns, data)
        path = recorder.close(DEADLINE)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    read = read_bag(path)
    assert len(read) == recorder.messages == 500 - recorder.drops
    assert len(read) > 250
    assert recorder.files > 2
    assert int(custom_data(path)['drops']) == recorder.drops
    assert 'File too large' in told.errors.get(timeout=DEADLINE)


def test_a_disk_with_hardly_any_room_is_not_written_to(tmp_path, topics, make, monkeypatch, disk):
    bag = BagWriter(tmp_path / 'b', topics)
    bag.write('/clock', 0, make.clock(0))
    bag.flush()
    bag.write('/clock', 1, make.clock(1))
    disk.full = True
    with pytest.raises(RecordingError, match='No space left'):
        bag.flush()
    disk.full = False

    def no_room(*_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    with monkeypatch.context() as patch:
        patch.setattr(os, 'posix_fallocate', no_room)
        with pytest.raises(RecordingError, match='No space left'):
            bag.resume()
    assert [entry.name for entry in (tmp_path / 'b').iterdir()] == ['b_0.mcap']
    assert bag.error is not None
    bag.resume()
    assert bag.error is None
    assert (bag.messages, bag.lost, bag.files) == (2, 0, 2)
    bag.close()


def test_a_file_that_lost_its_end_keeps_the_chunks_that_are_whole(
    tmp_path, topics, make, read_bag, disk
):
    bag = BagWriter(tmp_path / 'b', topics)
    for time_ns in range(3):
        bag.write('/clock', time_ns, make.clock(time_ns))
        bag.flush()
    file = tmp_path / 'b' / 'b_0.mcap'
    disk.full = True
    bag.write('/clock', 3, make.clock(3))
    with pytest.raises(RecordingError, match='No space left'):
        bag.flush()
    disk.full = False
    os.truncate(file, file.stat().st_size - 1)
    bag.resume()
    assert [time_ns for _, time_ns, _ in read_bag(bag.close())] == [0, 1, 3]
    assert json.loads(custom_data(bag.path)['gaps']) == [[2, 2, 1]]


def test_a_disk_that_stays_full_while_closing_keeps_what_was_flushed(
    start, told, disk, make, read_unfinished
):
    recorder = start()
    recorder.write('/clock', 0, make.clock(0))
    assert disk.written.acquire(timeout=DEADLINE)
    disk.full = True
    recorder.write('/clock', 1, make.clock(1))
    error = told.errors.get(timeout=DEADLINE)
    recorder.close(DEADLINE)
    assert recorder.error == error
    assert told.errors.empty()
    # Not even the index has room, so chunks were given up for it, in vain.
    assert recorder.messages + recorder.drops == 2
    assert read_unfinished(recorder.path / 'b_0.mcap') == []
