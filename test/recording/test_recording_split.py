from __future__ import annotations

import itertools
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader

from cube_sim.recording import BagWriter, Recorder, RecordingError
from cube_sim.recording.mcap_file import McapFile

DEADLINE = 30.0


def description(path: Path) -> dict[str, Any]:
    return yaml.safe_load((path / 'metadata.yaml').read_text())['rosbag2_bagfile_information']


def read_file(path: Path) -> list[tuple[str, int, bytes]]:
    with path.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_summary().statistics.schema_count == 3
        return [
            (channel.topic, row.log_time, row.data)
            for _, channel, row in reader.iter_messages(log_time_order=False)
        ]


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_no_file_is_larger_than_the_limit_and_together_they_are_one_bag(
    tmp_path, topics, make, read_bag, compression
):
    limit = 100_000
    written = [('/cube_sim/poses', time_ns, make.poses(time_ns, 20)) for time_ns in range(300)]
    with BagWriter(
        tmp_path / 'b', topics, chunk_size=10_000, max_bytes=limit, compression=compression
    ) as bag:
        for message in written:
            bag.write(*message)
        assert (bag.messages, bag.lost) == (300, 0)
        assert bag.bytes == sum(len(data) for _, _, data in written)
    found = description(bag.path)
    names = found['relative_file_paths']
    assert names == [f'b_{number}.mcap' for number in range(len(names))]
    assert len(names) == bag.files
    assert len(names) >= {'none': 4, 'lz4': 2, 'zstd': 1}[compression]
    parts = [read_file(bag.path / name) for name in names]
    assert list(itertools.chain(*parts)) == read_bag(bag.path) == written
    assert all((bag.path / name).stat().st_size <= limit for name in names)
    if compression == 'none':
        assert (bag.path / names[0]).stat().st_size > 0.8 * limit
    for file, part in zip(found['files'], parts, strict=True):
        assert file['message_count'] == len(part)
        assert file['starting_time'] == {'nanoseconds_since_epoch': part[0][1]}
        assert file['duration'] == {'nanoseconds': part[-1][1] - part[0][1]}
    assert found['message_count'] == 300


def test_a_message_above_the_limit_has_a_file_of_its_own(tmp_path, topics, make, read_bag):
    with BagWriter(tmp_path / 'b', topics, max_bytes=1) as bag:
        for time_ns in range(3):
            bag.write('/clock', time_ns, make.clock(time_ns))
    assert [file['message_count'] for file in description(bag.path)['files']] == [1, 1, 1]
    assert [time_ns for _, time_ns, _ in read_bag(bag.path)] == [0, 1, 2]


def test_a_file_ends_after_its_duration_of_log_time(tmp_path, topics, make):
    with BagWriter(tmp_path / 'b', topics, max_duration_ns=1_000) as bag:
        for time_ns in (500, 700, 1_499, 1_500, 9_000, 9_999):
            bag.write('/clock', time_ns, make.clock(time_ns))
    assert [
        (file['starting_time']['nanoseconds_since_epoch'], file['message_count'])
        for file in description(bag.path)['files']
    ] == [(500, 3), (1_500, 1), (9_000, 2)]


def test_sequence_numbers_go_on_from_file_to_file(tmp_path, topics, make):
    with BagWriter(tmp_path / 'b', topics, max_duration_ns=2) as bag:
        for time_ns in range(6):
            bag.write('/clock', time_ns, make.clock(time_ns))
    sequences = []
    for number in range(3):
        with (bag.path / f'b_{number}.mcap').open('rb') as stream:
            sequences += [row.sequence for _, _, row in make_reader(stream).iter_messages()]
    assert sequences == list(range(6))


def test_a_recorder_splits_and_compresses_too(tmp_path, topics, make, read_bag):
    with Recorder(
        tmp_path / 'b',
        topics,
        on_error=pytest.fail,
        compression='zstd',
        max_bytes=200_000,
        max_duration_ns=100,
    ) as recorder:
        for time_ns in range(250):
            recorder.write('/clock', time_ns, make.clock(time_ns))
    assert recorder.files == 3
    assert len(read_bag(recorder.path)) == recorder.messages == 250


def test_a_split_that_finds_no_room_loses_nothing(tmp_path, topics, make, read_bag, monkeypatch):
    bag = BagWriter(tmp_path / 'b', topics, max_duration_ns=2)
    bag.write('/clock', 0, make.clock(0))
    bag.write('/clock', 1, make.clock(1))
    create = McapFile.create

    def no_room(_: McapFile) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr(McapFile, 'create', no_room)
    with pytest.raises(RecordingError, match='No space left'):
        bag.write('/clock', 2, make.clock(2))
    with pytest.raises(RecordingError, match='No space left'):
        bag.resume()
    monkeypatch.setattr(McapFile, 'create', create)
    bag.resume()
    bag.write('/clock', 3, make.clock(3))
    assert [time_ns for _, time_ns, _ in read_bag(bag.close())] == [0, 1, 2, 3]
    assert [file['message_count'] for file in description(bag.path)['files']] == [2, 2]


@pytest.mark.parametrize('limits', [{'max_bytes': -1}, {'max_duration_ns': -1}])
def test_a_negative_limit_is_refused(tmp_path, topics, limits):
    with pytest.raises(RecordingError, match='must be positive, or 0'):
        BagWriter(tmp_path / 'b', topics, **limits)
    assert list(tmp_path.iterdir()) == []
