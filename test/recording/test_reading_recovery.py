from __future__ import annotations

import functools
import os
import random
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zstandard
from mcap.reader import make_reader
from mcap.writer import CompressionType
from rosbags.highlevel import AnyReader
from support.foreign_bags import TYPE, write_mcap, write_metadata

from cube_sim.recording import BagWriter, RecordingError, Topic, bag_directory, bag_notes
from cube_sim.recording.reader import BagReader
from cube_sim.recording.recovery import Recovery, recover
from cube_sim.recording.salvage import Salvage

Row = tuple[str, int, bytes]

TOPICS = [Topic('/a', 'std_msgs/msg/Empty'), Topic('/b', 'std_msgs/msg/Empty', depth=3)]
MESSAGES = [
    ('/' + 'ab'[number % 2], number * 7, b'\x00\x01\x00\x00%09d' % number) for number in range(15)
]
FOREIGN = [('/a', 7 * number, b'\x00\x01\x00\x00%05d' % number) for number in range(30)]


@pytest.fixture(autouse=True)
def _yaml_read_once(monkeypatch):
    """Most tries read the same texts, and reading them takes most of the time."""
    load = functools.lru_cache(bag_directory.load_yaml)
    monkeypatch.setattr(bag_directory, 'load_yaml', load)
    monkeypatch.setattr(bag_notes, 'load_yaml', load)


def small_bag(path: Path, **options: Any) -> Path:
    with BagWriter(path, TOPICS, chunk_size=120, **options) as bag:
        for message in MESSAGES:
            bag.write(*message)
    return path


def read(path: Path) -> list[Row]:
    with BagReader(path) as reader:
        return [(topic, time, bytes(data)) for topic, time, data in reader.messages()]


def salvaged(path: Path) -> list[Row]:
    """What there is to recover, without writing it."""
    found = Salvage(path, lambda done: None).messages()
    return [(row.channel.topic, row.time_ns, bytes(row.data)) for row in found]


def check_whole(result: Recovery) -> list[Row]:
    """Hold the new bag against rosbags and against what was told of it; return its messages."""
    rows = read(result.path)
    with AnyReader([result.path]) as theirs:
        assert sorted(
            (link.topic, time, bytes(data)) for link, time, data in theirs.messages()
        ) == (sorted(rows))
    assert len(rows) == result.messages
    if rows:
        assert (rows[0][1], rows[-1][1]) == (result.start_ns, result.end_ns)
    return rows


def chunks_of(path: Path) -> list[tuple[int, int, list[Row]]]:
    """Start, end and messages of each chunk, by the mcap package."""
    with path.open('rb') as stream:
        reader = make_reader(stream)
        return [
            (
                index.chunk_start_offset,
                index.chunk_start_offset + index.chunk_length,
                [
                    (channel.topic, message.log_time, message.data)
                    for _, channel, message in reader.iter_messages(
                        starting_at=index.message_start_time, ending_at=index.message_end_time
                    )
                ],
            )
            for index in reader.get_summary().chunk_indexes
        ]


def with_a_wrong_byte(path: Path, step: int = 1) -> Iterator[int]:
    chance = random.Random(3)
    content = path.read_bytes()
    with path.open('r+b', buffering=0) as file:
        for offset in range(0, len(content), step):
            os.pwrite(file.fileno(), bytes([content[offset] ^ chance.randrange(1, 256)]), offset)
            yield offset
            os.pwrite(file.fileno(), content[offset : offset + 1], offset)


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_a_sound_bag_becomes_an_equal_one(tmp_path, topics, make, compression):
    with BagWriter(tmp_path / 'b', topics, compression=compression, chunk_size=3000) as bag:
        for step in range(30):
            bag.write('/clock', step, make.clock(step))
            bag.write('/cube_sim/poses', step, make.poses(step, step))
    seen = []
    result = recover(tmp_path / 'b', progress=lambda done, total: seen.append((done, total)))
    assert result.path == tmp_path / 'b_recovered'
    assert (result.messages, result.lost_bytes, result.damaged) == (60, 0, [])
    assert result.chunks > 5
    assert check_whole(result) == read(tmp_path / 'b')
    with BagReader(tmp_path / 'b') as old, BagReader(result.path) as new:
        assert new.topics == old.topics
    size = (tmp_path / 'b' / 'b_0.mcap').stat().st_size
    assert seen == sorted(seen)
    assert seen[-1] == (size, size)


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_cut_off_anywhere_every_whole_chunk_is_recovered(tmp_path, compression):
    path = small_bag(tmp_path / 'b', compression=compression) / 'b_0.mcap'
    chunks = chunks_of(path)
    assert len(chunks) > 3
    step = 1 if compression == 'none' else 7
    for length in reversed(range(0, path.stat().st_size, step)):
        os.truncate(path, length)
        proven = [row for _, end, rows in chunks for row in rows if end <= length]
        rows = salvaged(path)
        assert rows[: len(proven)] == proven
        assert rows == MESSAGES[: len(rows)]


def test_the_front_of_a_cut_off_chunk_is_kept_message_by_message(tmp_path):
    path = small_bag(tmp_path / 'b') / 'b_0.mcap'
    start, end, rows = chunks_of(path)[1]
    os.truncate(path, end - 1)
    assert salvaged(path) == MESSAGES[: MESSAGES.index(rows[-1])]
    result = recover(path)
    assert check_whole(result) == MESSAGES[: MESSAGES.index(rows[-1])]
    assert any(f'the chunk from {start} on is cut off' in words for words in result.damaged)
    assert any('messages have no checksum' in words for words in result.damaged)
    assert 0 < result.lost_bytes < end - start


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_with_a_wrong_byte_anywhere_every_other_chunk_is_recovered(tmp_path, compression):
    path = small_bag(tmp_path / 'b', compression=compression) / 'b_0.mcap'
    chunks = chunks_of(path)
    for offset in with_a_wrong_byte(path, step=1 if compression == 'none' else 7):
        proven = [row for start, end, rows in chunks for row in rows if not start <= offset < end]
        rows = salvaged(path)
        assert [row for row in rows if row in proven] == proven, offset
        assert [row for row in MESSAGES if row in rows] == rows, offset


@pytest.mark.parametrize(
    'options', [{}, {'use_chunking': False}, {'compression': CompressionType.ZSTD}],
    ids=['chunks', 'no chunks', 'zstd'],
)  # fmt: skip
def test_cut_off_bags_of_others_are_recovered_up_to_the_cut(tmp_path, options):
    path = write_mcap(tmp_path / 'b.mcap', FOREIGN, **options)
    ends = []
    for length in reversed(range(path.stat().st_size)):
        os.truncate(path, length)
        rows = salvaged(path)
        assert rows == FOREIGN[: len(rows)]
        ends.append(len(rows))
    assert ends == sorted(ends, reverse=True)
    assert ends[0] == 30
    # Of messages that are not compressed, every single one counts.
    assert 'compression' in options or set(ends) == set(range(31))


@pytest.mark.parametrize('options', [{}, {'use_chunking': False}, {'enable_crcs': False}])
def test_a_wrong_byte_in_bags_of_others_costs_one_record(tmp_path, options):
    path = write_mcap(tmp_path / 'b.mcap', FOREIGN, chunk_size=150, **options)
    for _ in with_a_wrong_byte(path, step=5):
        rows = salvaged(path)
        # Without a checksum a changed time or payload may be there; never more than what was.
        assert len(rows) <= 30
        if not options:
            assert [row for row in FOREIGN if row in rows] == rows


@pytest.mark.parametrize('place', [0.1, 0.3, 0.5, 0.7])
@pytest.mark.parametrize('change', ['removed', 'zeroed', 'random', 'inserted'])
def test_a_broken_stretch_costs_what_it_touches(tmp_path, topics, make, place, change):
    with BagWriter(tmp_path / 'b', topics, chunk_size=3000) as bag:
        for step in range(60):
            bag.write('/cube_sim/poses', step, make.poses(step, 10))
    path = tmp_path / 'b' / 'b_0.mcap'
    chunks = chunks_of(path)
    content = path.read_bytes()
    at, size = round(len(content) * place), 5000
    stretch = {
        'removed': b'',
        'zeroed': bytes(size),
        'random': random.Random(1).randbytes(size),
        'inserted': random.Random(1).randbytes(size) + content[at : at + size],
    }[change]
    path.write_bytes(content[:at] + stretch + content[at + size :])
    proven = [row for start, end, rows in chunks for row in rows if end <= at or start >= at + size]
    result = recover(tmp_path / 'b')
    rows = check_whole(result)
    assert [row for row in rows if row in proven] == proven
    assert [row for row in [row for _, _, rows in chunks for row in rows] if row in rows] == rows
    assert result.damaged
    assert result.lost_bytes > 0


@pytest.mark.parametrize('part', [0.35, 0.5, 0.7, 0.97])
def test_a_recovered_bag_is_whole_for_every_reader(tmp_path, topics, make, part):
    with BagWriter(tmp_path / 'b', topics, compression='zstd', chunk_size=3000) as bag:
        for step in range(60):
            bag.write('/clock', step, make.clock(step))
            bag.write('/cube_sim/poses', step, make.poses(step, 10))
    path = tmp_path / 'b' / 'b_0.mcap'
    os.truncate(path, round(path.stat().st_size * part))
    (tmp_path / 'b' / 'metadata.yaml').unlink()
    result = recover(tmp_path / 'b', tmp_path / 'new')
    rows = check_whole(result)
    assert result.path == tmp_path / 'new'
    with BagReader(result.path) as reader:
        assert reader.topics.keys() == {'/clock', '/cube_sim/poses', '/cube_sim/resets'}
        assert reader.topics['/clock'].type == 'rosgraph_msgs/msg/Clock'
        assert reader.topics['/clock'].count == sum(row[0] == '/clock' for row in rows)
    assert {entry.name for entry in result.path.iterdir()} == {'new_0.mcap', 'metadata.yaml'}


def test_split_bags_are_recovered_file_by_file(tmp_path):
    bag = small_bag(tmp_path / 'b', max_duration_ns=40)
    files = sorted(bag.glob('*.mcap'))
    assert len(files) > 2
    content = files[1].read_bytes()
    files[1].write_bytes(content[: content.index(MESSAGES[7][2])])
    files[0].write_bytes(b'')
    (bag / 'metadata.yaml').write_text('nonsense: [')
    result = recover(bag)
    rows = check_whole(result)
    assert rows == [row for row in MESSAGES if row in rows]
    assert MESSAGES[-1] in rows
    assert MESSAGES[0] not in rows
    assert any(f'{files[0].name}, it is empty' in words for words in result.damaged)
    assert len(list(result.path.glob('*.mcap'))) == len(files)


def test_drops_are_kept_and_what_was_lost_is_noted(tmp_path):
    with BagWriter(tmp_path / 'b', TOPICS, chunk_size=120) as bag:
        for message in MESSAGES:
            bag.write(*message)
        bag.drops.add(3, 7, {'/a': 2})
    with BagReader(tmp_path / 'b') as reader:
        drops, gaps = reader.drops, reader.gaps
    path = tmp_path / 'b' / 'b_0.mcap'
    content = bytearray(path.read_bytes())
    content[content.index(MESSAGES[4][2]) + 5] ^= 1
    path.write_bytes(content)
    result = recover(tmp_path / 'b')
    assert result.lost_bytes > 0
    assert 'does not fit its checksum' in result.damaged[0]
    with BagReader(result.path) as reader:
        assert (reader.drops, reader.gaps) == (drops, gaps) == (2, gaps)


def test_messages_that_rosbag2_compressed_are_recovered_as_they_were(tmp_path):
    packed = [(topic, time_ns, zstandard.compress(data)) for topic, time_ns, data in FOREIGN]
    packed[4] = (packed[4][0], packed[4][1], packed[4][2][:-1])
    write_mcap(tmp_path / 'b_0.mcap', packed)
    result = recover(tmp_path / 'b_0.mcap')
    assert check_whole(result) == FOREIGN[:4] + FOREIGN[5:]
    assert any('a compressed message is broken' in words for words in result.damaged)


def test_a_compressed_file_is_recovered_up_to_where_it_is_cut(tmp_path):
    bag = tmp_path / 'b'
    bag.mkdir()
    content = write_mcap(tmp_path / 'plain.mcap', FOREIGN * 200, chunk_size=2000).read_bytes()
    packed = zstandard.compress(content)
    (bag / 'b_0.mcap.zstd').write_bytes(packed[: len(packed) // 2])
    result = recover(bag)
    rows = check_whole(result)
    assert 0 < len(rows) < 6000
    assert 'compressed data end too early' in result.damaged[0]


def test_several_channels_of_a_topic_become_one(tmp_path):
    path = write_mcap(tmp_path / 'b.mcap', FOREIGN, channels_per_topic=3)
    os.truncate(path, path.stat().st_size - 50)
    result = recover(path)
    assert check_whole(result) == FOREIGN
    with BagReader(result.path) as reader:
        assert reader.topics['/a'].type == TYPE


def test_an_existing_directory_is_not_overwritten(tmp_path):
    bag = small_bag(tmp_path / 'b')
    (tmp_path / 'b_recovered').mkdir()
    for target in (None, tmp_path / 'b_recovered'):
        with pytest.raises(RecordingError, match='exists already, not overwriting'):
            recover(bag, target)
    assert list((tmp_path / 'b_recovered').iterdir()) == []


def test_where_there_is_nothing_nothing_is_left_behind(tmp_path):
    noise = random.Random(1).randbytes(20_000)
    (tmp_path / 'b.mcap').write_bytes(b'\x89MCAP0\r\n' + noise)
    with pytest.raises(RecordingError, match='Nothing can be recovered'):
        recover(tmp_path / 'b.mcap')
    assert [entry.name for entry in tmp_path.iterdir()] == ['b.mcap']


@pytest.mark.parametrize(
    ('name', 'content', 'words'),
    [
        ('none', None, 'does not exist'),
        ('b.mcap', b'', 'is empty'),
        ('b.txt', b'text', 'is not an MCAP file'),
        ('b.db3', b'SQLite format 3\0', 'rosbags-convert'),
    ],
)
def test_what_is_no_bag_at_all_is_refused(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(RecordingError, match=words):
        recover(tmp_path / name)


def test_an_empty_directory_is_refused(tmp_path):
    with pytest.raises(RecordingError, match=r'no \.mcap files'):
        recover(tmp_path)


def test_a_full_disk_is_one_clear_error_and_leaves_nothing(tmp_path, monkeypatch):
    bag = small_bag(tmp_path / 'b')

    def full(*_: Any) -> None:
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('cube_sim.recording.recovery.write_metadata', full)
    with pytest.raises(RecordingError, match=r'No space left on device.*; make room'):
        recover(bag)
    assert not (tmp_path / 'b_recovered').exists()


def test_only_metadata_is_written_in_place(tmp_path):
    bag = small_bag(tmp_path / 'b', max_duration_ns=40)
    right = read(bag)
    with BagReader(bag) as reader:
        topics = reader.topics
    (bag / 'metadata.yaml').unlink()
    before = {path.name: path.read_bytes() for path in bag.iterdir()}
    result = recover(bag, in_place=True)
    assert (result.path, result.messages, result.lost_bytes) == (bag, 15, 0)
    assert check_whole(result) == right
    with BagReader(bag) as reader:
        assert reader.topics == topics
    after = {path.name: path.read_bytes() for path in bag.iterdir()}
    assert after.pop('metadata.yaml')
    assert after == before


def test_nothing_is_written_in_place_if_anything_else_is_wrong(tmp_path):
    bag = small_bag(tmp_path / 'b')
    with pytest.raises(RecordingError, match='exists already'):
        recover(bag, in_place=True)
    (bag / 'metadata.yaml').unlink()
    with pytest.raises(RecordingError, match='no other target'):
        recover(bag, tmp_path / 'c', in_place=True)
    path = bag / 'b_0.mcap'
    for _ in zip(range(20), with_a_wrong_byte(path, step=path.stat().st_size // 20), strict=False):
        shutil.rmtree(tmp_path / 'c', ignore_errors=True)
        shutil.copytree(bag, tmp_path / 'c')
        try:
            recover(tmp_path / 'c', in_place=True)
        except RecordingError:
            assert not (tmp_path / 'c' / 'metadata.yaml').exists()
        else:
            assert read(tmp_path / 'c') == MESSAGES


def test_a_bag_without_metadata_can_be_written_by_rosbag2_too(tmp_path):
    path = write_mcap(tmp_path / 'b_0.mcap', FOREIGN)
    write_metadata(tmp_path, ['b_0.mcap'], FOREIGN)
    (tmp_path / 'metadata.yaml').unlink()
    assert check_whole(recover(tmp_path, in_place=True)) == FOREIGN
    assert path.exists()
