from __future__ import annotations

import math
import threading
from typing import Any

import pytest
import yaml

from cube_sim.recording import BagWriter, Recorder, RecordingError
from cube_sim.recording.mcap_file import McapFile

DEADLINE = 30.0


class Gate:
    """Holds the recorder's thread in BagWriter.write until opened."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.reached = threading.Event()
        self.opened = threading.Event()
        write = BagWriter.write

        def held(bag: BagWriter, *message: Any) -> None:
            self.reached.set()
            assert self.opened.wait(DEADLINE)
            write(bag, *message)

        monkeypatch.setattr(BagWriter, 'write', held)


def no_error(text: str) -> None:
    raise AssertionError(text)


def custom_data(path) -> dict[str, str]:
    information = yaml.safe_load((path / 'metadata.yaml').read_text())
    return information['rosbag2_bagfile_information']['custom_data']


def test_everything_written_is_in_the_bag_in_order(tmp_path, topics, make, read_bag):
    recorder = Recorder(tmp_path / 'b', topics, on_error=no_error)
    written = [('/cube_sim/poses', time_ns, make.poses(time_ns, 30)) for time_ns in range(500)]
    for message in written:
        assert recorder.write(*message)
    assert recorder.close(DEADLINE) == recorder.path == tmp_path / 'b'
    assert read_bag(recorder.path) == written
    assert recorder.messages == 500
    assert recorder.bytes == sum(len(data) for _, _, data in written)
    assert (recorder.drops, recorder.error) == (0, None)
    assert custom_data(recorder.path) == {'drops': '0'}


def test_many_threads_lose_nothing(tmp_path, topics, make, read_bag):
    recorder = Recorder(tmp_path / 'b', topics, on_error=no_error)

    def write(first: int) -> None:
        for time_ns in range(first, first + 200):
            recorder.write('/clock', time_ns, make.clock(time_ns))

    threads = [threading.Thread(target=write, args=(first,)) for first in range(0, 1000, 200)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(DEADLINE)
    read = read_bag(recorder.close(DEADLINE))
    assert sorted(read) == [('/clock', time_ns, make.clock(time_ns)) for time_ns in range(1000)]


def test_a_full_queue_drops_and_counts_but_never_waits(
    tmp_path, topics, make, read_bag, monkeypatch
):
    gate = Gate(monkeypatch)
    recorder = Recorder(tmp_path / 'b', topics, on_error=no_error, queue_bytes=10_000)
    # Nothing leaves the queue before the gate opens, so a write that waited would end the test.
    taken = [recorder.write('/clock', time_ns, make.clock(time_ns)) for time_ns in range(100)]
    assert gate.reached.wait(DEADLINE)
    count = taken.count(True)
    assert taken == [True] * count + [False] * (100 - count)
    assert 10 < count < 10_000 / len(make.clock(0))
    assert recorder.drops == 100 - count
    assert not recorder.write('/cube_sim/poses', 0, make.poses(0, 10_000)), 'beyond the bound'
    gate.opened.set()
    assert len(read_bag(recorder.close(DEADLINE))) == recorder.messages == count
    assert custom_data(recorder.path) == {
        'drops': str(101 - count),
        'gaps': f'[[0, 99, {101 - count}]]',
        'drops_by_topic': f'{{"/clock": {100 - count}, "/cube_sim/poses": 1}}',
    }


def test_room_in_the_queue_comes_back(tmp_path, topics, make, monkeypatch):
    gate = Gate(monkeypatch)
    recorder = Recorder(
        tmp_path / 'b', topics, on_error=no_error, queue_bytes=1000, flush_period=0.0
    )
    written = threading.Semaphore(0)
    write_one = Recorder._write_one
    monkeypatch.setattr(
        Recorder, '_write_one', lambda recorder: (write_one(recorder), written.release())
    )
    data = make.clock(0)
    taken = [recorder.write('/clock', 0, data) for _ in range(10)].count(True)
    assert 0 < taken < 10
    gate.opened.set()
    for _ in range(taken):
        assert written.acquire(timeout=DEADLINE)
    assert [recorder.write('/clock', 0, data) for _ in range(taken)] == [True] * taken
    recorder.close(DEADLINE)
    assert recorder.messages == 2 * taken


def test_what_is_written_reaches_the_file_while_recording(
    tmp_path, topics, make, read_unfinished, monkeypatch
):
    flushed = threading.Event()
    flush = McapFile.flush

    def tell(file: McapFile) -> None:
        flush(file)
        flushed.set()

    monkeypatch.setattr(McapFile, 'flush', tell)
    recorder = Recorder(tmp_path / 'b', topics, on_error=no_error, flush_period=0.01)
    recorder.write('/clock', 3, make.clock(3))
    assert flushed.wait(DEADLINE)
    assert read_unfinished(tmp_path / 'b' / 'b_0.mcap') == [(3, make.clock(3))]
    recorder.close(DEADLINE)


def test_the_same_messages_make_the_same_bytes_without_a_flush_period(tmp_path, topics, make):
    for parent in ('one', 'two'):
        with Recorder(
            tmp_path / parent / 'b', topics, on_error=no_error, flush_period=math.inf
        ) as recorder:
            for time_ns in range(100):
                recorder.write('/cube_sim/poses', time_ns, make.poses(time_ns, 300))
    for name in ('b_0.mcap', 'metadata.yaml'):
        assert (tmp_path / 'one/b' / name).read_bytes() == (tmp_path / 'two/b' / name).read_bytes()


def test_closing_twice_is_closing_once(tmp_path, topics, make):
    recorder = Recorder(tmp_path / 'b', topics, on_error=no_error)
    recorder.write('/clock', 1, make.clock(1))
    path = recorder.close(DEADLINE)
    before = (path / 'b_0.mcap').read_bytes()
    assert not recorder.write('/clock', 2, make.clock(2))
    assert recorder.close(DEADLINE) == path
    assert (path / 'b_0.mcap').read_bytes() == before
    assert (recorder.messages, recorder.drops) == (1, 1)


def test_closing_says_when_the_disk_is_too_slow_and_may_be_tried_again(
    tmp_path, topics, make, read_bag, monkeypatch
):
    gate = Gate(monkeypatch)
    recorder = Recorder(tmp_path / 'b', topics, on_error=no_error)
    recorder.write('/clock', 1, make.clock(1))
    assert gate.reached.wait(DEADLINE)
    with pytest.raises(RecordingError, match='was not finished within 0 s'):
        recorder.close(timeout=0)
    gate.opened.set()
    assert read_bag(recorder.close(DEADLINE)) == [('/clock', 1, make.clock(1))]


def test_a_disk_that_stays_full_is_told_once_and_the_caller_goes_on(
    tmp_path, topics, make, read_bag, monkeypatch
):
    told: list[str] = []
    failed = threading.Event()

    def on_error(text: str) -> None:
        told.append(text)
        failed.set()
        raise RuntimeError('a logger that is gone')

    append = McapFile._append
    chunks = iter(range(3))

    def fill_up(file: McapFile, *parts: bytes) -> None:
        if next(chunks, None) is None:
            raise OSError(28, 'No space left on device')
        append(file, *parts)

    monkeypatch.setattr(McapFile, '_append', fill_up)  # the head and a chunk or two fit
    recorder = Recorder(
        tmp_path / 'b', topics, on_error=on_error, flush_period=0.0, queue_bytes=100_000
    )
    taken = written = 0
    while not failed.is_set():
        taken += recorder.write('/clock', written, make.clock(written))
        written += 1
    while recorder.write('/clock', written, make.clock(written)):
        written += 1
    written += 1
    assert 'No space left on device' in recorder.error
    assert 50_000 < recorder.waiting_bytes <= 100_000
    path = recorder.close(DEADLINE)
    assert told == [recorder.error]
    assert recorder.messages + recorder.drops == written
    read = read_bag(path)
    assert read == [('/clock', time_ns, make.clock(time_ns)) for time_ns in range(len(read))]
    assert 1 <= len(read) == recorder.messages
    assert custom_data(path) == {
        'drops': str(recorder.drops),
        'gaps': f'[[{len(read)}, {written - 1}, {recorder.drops}]]',
        'drops_by_topic': f'{{"/clock": {recorder.drops}}}',
        'error': recorder.error,
    }
    assert recorder.waiting_bytes == 0


def test_a_disk_that_fills_up_while_closing_is_told_too(
    tmp_path, topics, make, read_bag, monkeypatch
):
    finish = McapFile.finish
    failures = iter([OSError(28, 'No space left on device')])

    def fail_once(file: McapFile, notes: Any) -> None:
        for error in failures:
            raise error
        finish(file, notes)

    monkeypatch.setattr(McapFile, 'finish', fail_once)
    told: list[str] = []
    recorder = Recorder(tmp_path / 'b', topics, on_error=told.append)
    recorder.write('/clock', 1, make.clock(1))
    path = recorder.close(DEADLINE)
    assert told == [recorder.error]
    assert (recorder.messages, recorder.drops) == (0, 1)
    assert read_bag(path) == []


def test_even_a_fault_of_the_recorder_itself_does_not_reach_the_caller(
    tmp_path, topics, make, monkeypatch
):
    def broken(*_: Any) -> None:
        raise ZeroDivisionError('a bug')

    told: list[str] = []
    failed = threading.Event()
    monkeypatch.setattr(BagWriter, 'write', broken)
    recorder = Recorder(
        tmp_path / 'b', topics, on_error=lambda text: (told.append(text), failed.set())
    )
    assert recorder.write('/clock', 1, make.clock(1))
    assert failed.wait(DEADLINE)
    recorder.close(DEADLINE)
    assert len(told) == 1
    assert 'a bug' in told[0]
    assert not recorder.write('/clock', 2, make.clock(2))


def test_a_wrong_message_is_the_callers_error(tmp_path, topics, make):
    recorder = Recorder(tmp_path / 'b', topics, on_error=no_error)
    with pytest.raises(RecordingError, match='/nowhere is not a topic'):
        recorder.write('/nowhere', 0, b'')
    with pytest.raises(RecordingError, match='log time of -1 ns'):
        recorder.write('/clock', -1, b'')
    assert recorder.write('/clock', 0, make.clock(0))
    recorder.close(DEADLINE)
    assert (recorder.messages, recorder.drops, recorder.error) == (1, 0, None)


def test_a_bag_that_cannot_be_made_is_an_error_at_once(tmp_path, topics):
    threads = threading.active_count()
    (tmp_path / 'b').mkdir()
    with pytest.raises(RecordingError, match='exists already, not overwriting'):
        Recorder(tmp_path / 'b', topics, on_error=no_error)
    assert threading.active_count() == threads
