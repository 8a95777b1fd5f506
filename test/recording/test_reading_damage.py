"""Truncated anywhere, one byte wrong anywhere: right values or RecordingError, nothing else."""

from __future__ import annotations

import contextlib
import functools
import os
import random
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.writer import CompressionType
from support.foreign_bags import write_mcap

from cube_sim.recording import BagWriter, RecordingError, Topic, bag_directory, bag_notes
from cube_sim.recording.reader import BagReader

TOPICS = [Topic('/a', 'std_msgs/msg/Empty'), Topic('/b', 'std_msgs/msg/Empty', depth=3)]


@pytest.fixture(autouse=True)
def _yaml_read_once(monkeypatch):
    """Most tries read the same texts, and reading them takes most of the time."""
    load = functools.lru_cache(bag_directory.load_yaml)
    monkeypatch.setattr(bag_directory, 'load_yaml', load)
    monkeypatch.setattr(bag_notes, 'load_yaml', load)


def small_bag(path: Path, **options: Any) -> Path:
    with BagWriter(path, TOPICS, chunk_size=250, **options) as bag:
        for number in range(15):
            bag.write('/ab'[:1] + 'ab'[number % 2], number * 7, b'\x00\x01\x00\x00%09d' % number)
        bag.drops.add(3, 7, {'/a': 2})
    return path


def everything(path: Path) -> Any:
    with BagReader(path) as reader:
        return (
            reader.topics,
            (reader.drops, reader.gaps, reader.start_ns, reader.end_ns, reader.message_count),
            [(topic, time, bytes(data)) for topic, time, data in reader.messages()],
        )


def with_a_wrong_byte(path: Path, step: int = 1, seed: int = 1) -> Iterator[int]:
    """Change one byte of the file, in one bit or in several, at each offset in turn."""
    chance = random.Random(seed)
    content = path.read_bytes()
    with path.open('r+b', buffering=0) as file:
        for offset in range(0, len(content), step):
            mask = chance.choice([1 << chance.randrange(8), chance.randrange(1, 256)])
            os.pwrite(file.fileno(), bytes([content[offset] ^ mask]), offset)
            yield offset
            os.pwrite(file.fileno(), content[offset : offset + 1], offset)


def outcome(bag: Path, right: Any) -> str:
    try:
        assert everything(bag) == right
    except RecordingError:
        return 'refused'
    return 'right'


@pytest.mark.parametrize(('compression', 'step'), [('none', 1), ('lz4', 7), ('zstd', 7)])
def test_a_wrong_byte_anywhere_is_refused_or_does_not_matter(tmp_path, compression, step):
    bag = small_bag(tmp_path / 'b', compression=compression)
    right = everything(bag)
    assert len(right[2]) == 15
    outcomes = [outcome(bag, right) for _ in with_a_wrong_byte(bag / 'b_0.mcap', step)]
    # Much of the file is there twice, and read from where a checksum covers it.
    assert 0.3 < outcomes.count('refused') / len(outcomes) < 0.9
    assert everything(bag) == right


def test_a_wrong_byte_in_a_file_alone_is_refused_or_does_not_matter(tmp_path):
    path = small_bag(tmp_path / 'b') / 'b_0.mcap'
    right = everything(path)
    for _ in with_a_wrong_byte(path, step=5):
        outcome(path, right)


def test_a_wrong_byte_anywhere_in_metadata_is_refused_or_does_not_matter(tmp_path):
    bag = small_bag(tmp_path / 'b')
    right = everything(bag)
    for _ in with_a_wrong_byte(bag / 'metadata.yaml'):
        outcome(bag, right)


@pytest.mark.parametrize(('compression', 'step'), [('none', 1), ('zstd', 5)])
def test_a_file_that_is_cut_off_anywhere_is_refused(tmp_path, compression, step):
    bag = small_bag(tmp_path / 'b', compression=compression)
    path = bag / 'b_0.mcap'
    for length in reversed(range(0, path.stat().st_size, step)):
        os.truncate(path, length)
        with pytest.raises(RecordingError):
            BagReader(bag)


def test_a_split_bag_with_a_wrong_byte_is_refused_or_right(tmp_path):
    bag = small_bag(tmp_path / 'b', max_duration_ns=50)
    right = everything(bag)
    for path in sorted(bag.glob('*.mcap')):
        for _ in with_a_wrong_byte(path, step=11):
            outcome(bag, right)
    assert everything(bag) == right


@pytest.mark.parametrize(
    'options',
    [
        {},
        {'use_chunking': False, 'enable_data_crcs': True},
        {'enable_crcs': False, 'enable_data_crcs': True},
        {'compression': CompressionType.ZSTD, 'chunk_size': 100},
    ],
    ids=['chunks', 'no chunks', 'one checksum', 'zstd'],
)
def test_a_wrong_byte_in_a_bag_of_others_is_refused_or_does_not_matter(tmp_path, options):
    messages = [('/a', 7 * number, b'\x00\x01\x00\x00%05d' % number) for number in range(12)]
    path = write_mcap(tmp_path / 'b.mcap', messages, **{'chunk_size': 200, **options})
    right = everything(path)
    for _ in with_a_wrong_byte(path, step=2):
        outcome(path, right)


@pytest.mark.parametrize('chunking', [True, False])
def test_damage_in_a_file_without_any_checksum_raises_nothing_else(tmp_path, chunking):
    messages = [('/a', 7 * number, b'\x00\x01\x00\x00%05d' % number) for number in range(12)]
    path = write_mcap(
        tmp_path / 'b.mcap', messages, enable_crcs=False, use_chunking=chunking, chunk_size=200
    )
    for _ in with_a_wrong_byte(path, step=3):
        with contextlib.suppress(RecordingError):
            everything(path)


def test_random_damage_in_several_places_raises_nothing_else(tmp_path):
    bag = small_bag(tmp_path / 'b', compression='zstd')
    path = bag / 'b_0.mcap'
    content = path.read_bytes()
    right = everything(bag)
    chance = random.Random(2)
    with path.open('r+b', buffering=0) as file:
        for _ in range(300):
            damaged = bytearray(content)
            start = chance.randrange(len(content))
            for _ in range(chance.randrange(1, 30)):
                place = min(start + chance.randrange(60), len(content) - 1)
                damaged[place] = chance.choice([0, 0xFF, chance.randrange(256)])
            os.pwrite(file.fileno(), damaged, 0)
            outcome(bag, right)
