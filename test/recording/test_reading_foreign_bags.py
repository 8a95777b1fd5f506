from __future__ import annotations

from pathlib import Path

import pytest
import zstandard
from mcap.writer import CompressionType, IndexType, Writer
from rosbags.highlevel import AnyReader
from support.foreign_bags import DEFINITION, TYPE, write_mcap, write_metadata

from cube_sim.recording import RecordingError
from cube_sim.recording.reader import BagReader

# In the order of writing; times overlap from chunk to chunk.
MESSAGES = [
    (
        f'/topic_{number % 3}',
        1000 + 10 * number - 35 * (number % 4),
        b'\x00\x01\x00\x00%03d' % number,
    )
    for number in range(60)
]
IN_ORDER = sorted(MESSAGES, key=lambda message: message[1])


def read(path: Path, topics: list[str] | None = None) -> list[tuple[str, int, bytes]]:
    with BagReader(path) as reader:
        return [(topic, time, bytes(data)) for topic, time, data in reader.messages(topics)]


@pytest.mark.parametrize(
    'options',
    [
        {},
        {'compression': CompressionType.LZ4},
        {'compression': CompressionType.ZSTD},
        {'use_chunking': False},
        {'use_chunking': False, 'enable_data_crcs': True},
        {'index_types': IndexType.NONE},
        {'index_types': IndexType.CHUNK},
        {'index_types': IndexType.MESSAGE},
        {'use_statistics': False},
        {'repeat_channels': False},
        {'repeat_schemas': False},
        {'repeat_channels': False, 'repeat_schemas': False, 'use_statistics': False},
        {'use_summary_offsets': False},
        {'enable_crcs': False},
        {'enable_crcs': False, 'enable_data_crcs': True},
        {'channels_per_topic': 3},
        {'chunk_size': 1},
        {'chunk_size': 10**6},
        {
            'use_chunking': False,
            'index_types': IndexType.NONE,
            'use_statistics': False,
            'repeat_channels': False,
            'repeat_schemas': False,
            'use_summary_offsets': False,
        },
    ],
    ids=lambda options: ', '.join(f'{key}={value}' for key, value in options.items()) or 'plain',
)
def test_any_way_to_write_mcap_can_be_read(tmp_path, options):
    path = write_mcap(tmp_path / 'b.mcap', MESSAGES, **options)
    assert read(path) == IN_ORDER
    assert read(path, ['/topic_1']) == [row for row in IN_ORDER if row[0] == '/topic_1']
    write_metadata(tmp_path, ['b.mcap'], MESSAGES)
    with BagReader(tmp_path) as reader:
        assert reader.message_count == 60
        assert (reader.start_ns, reader.end_ns) == (IN_ORDER[0][1], IN_ORDER[-1][1])
        assert (reader.drops, reader.gaps) == (0, [])
        topic = reader.topics['/topic_0']
        assert (topic.type, topic.definition, topic.count) == (TYPE, DEFINITION, 20)
        assert [profile['depth'] for profile in topic.qos] == [10]


def test_messages_in_and_outside_of_chunks_come_together(tmp_path):
    path = tmp_path / 'b.mcap'
    with path.open('wb') as out:
        writer = Writer(out, chunk_size=10**6)
        writer.start('ros2', 'another recorder')
        schema = writer.register_schema(TYPE, 'ros2msg', DEFINITION.encode())
        channel = writer.register_channel('/a', 'cdr', schema)
        for number in range(6):
            chunks = writer._Writer__chunk_builder
            if number == 3:
                writer.flush()
                writer._Writer__chunk_builder = None
            writer.add_message(channel, number, b'%d' % number, number)
        writer._Writer__chunk_builder = chunks
        writer.finish()
    assert [data for _, _, data in read(path)] == [b'%d' % number for number in range(6)]


@pytest.mark.parametrize('chunking', [True, False])
def test_messages_that_rosbag2_compressed_one_by_one_are_read(tmp_path, chunking):
    packed = [(topic, time_ns, zstandard.compress(data)) for topic, time_ns, data in MESSAGES]
    write_mcap(tmp_path / 'b_0.mcap', packed, use_chunking=chunking)
    write_metadata(
        tmp_path, ['b_0.mcap'], packed, compression_format='zstd', compression_mode='MESSAGE'
    )
    assert read(tmp_path) == IN_ORDER
    if not chunking:
        return  # rosbags cannot sort what is in no chunk
    with AnyReader([tmp_path]) as theirs:
        assert sorted(bytes(data) for _, _, data in theirs.messages()) == sorted(
            data for _, _, data in IN_ORDER
        )


def test_a_file_alone_tells_that_its_messages_are_compressed(tmp_path):
    packed = [(topic, time_ns, zstandard.compress(data)) for topic, time_ns, data in MESSAGES]
    note = {'serialized_metadata': '{compression_format: zstd, compression_mode: MESSAGE}'}
    path = write_mcap(tmp_path / 'b_0.mcap', packed, notes={'rosbag2': note})
    assert read(path) == IN_ORDER


def test_a_message_whose_compression_is_broken_is_an_error(tmp_path):
    packed = [(topic, time_ns, zstandard.compress(data)) for topic, time_ns, data in MESSAGES]
    packed[7] = (packed[7][0], packed[7][1], packed[7][2][:-2])
    write_mcap(tmp_path / 'b_0.mcap', packed)
    write_metadata(
        tmp_path, ['b_0.mcap'], packed, compression_format='zstd', compression_mode='MESSAGE'
    )
    with pytest.raises(RecordingError, match='a message cannot be decompressed'):
        read(tmp_path)


def compress_files(directory: Path, names: list[str]) -> list[str]:
    for name in names:
        content = (directory / name).read_bytes()
        (directory / f'{name}.zstd').write_bytes(zstandard.compress(content))
        (directory / name).unlink()
    return [f'{name}.zstd' for name in names]


def test_split_files_that_rosbag2_compressed_are_read(tmp_path):
    write_mcap(tmp_path / 'b_0.mcap', MESSAGES[:30])
    write_mcap(tmp_path / 'b_1.mcap', MESSAGES[30:])
    names = compress_files(tmp_path, ['b_0.mcap', 'b_1.mcap'])
    write_metadata(tmp_path, names, MESSAGES, compression_format='zstd', compression_mode='FILE')
    assert read(tmp_path) == IN_ORDER
    with BagReader(tmp_path) as reader:
        assert [file.name for file in reader.files] == names
    assert read(tmp_path / names[0]) == sorted(MESSAGES[:30], key=lambda message: message[1])
    with AnyReader([tmp_path]) as theirs:
        assert sum(1 for _ in theirs.messages()) == 60


def test_a_compressed_file_that_is_cut_off_is_an_error(tmp_path):
    write_mcap(tmp_path / 'b_0.mcap', MESSAGES)
    names = compress_files(tmp_path, ['b_0.mcap'])
    path = tmp_path / names[0]
    path.write_bytes(path.read_bytes()[:-9])
    write_metadata(tmp_path, names, MESSAGES, compression_format='zstd', compression_mode='FILE')
    with pytest.raises(RecordingError, match='compressed data end too early'):
        BagReader(tmp_path)


def test_the_temporary_files_of_a_compressed_bag_are_gone_when_it_is_closed(tmp_path, monkeypatch):
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path / 'temporary'))
    (tmp_path / 'temporary').mkdir()
    bag = tmp_path / 'b'
    bag.mkdir()
    write_mcap(bag / 'b_0.mcap', MESSAGES)
    names = compress_files(bag, ['b_0.mcap'])
    write_metadata(bag, names, MESSAGES, compression_format='zstd', compression_mode='FILE')
    with BagReader(bag):
        assert len(list((tmp_path / 'temporary').iterdir())) == 1
    assert list((tmp_path / 'temporary').iterdir()) == []


def test_file_names_with_the_bags_directory_are_understood(tmp_path):
    write_mcap(tmp_path / 'b_0.mcap', MESSAGES)
    write_metadata(tmp_path, ['some/where/b_0.mcap'], MESSAGES, version=3)
    assert read(tmp_path) == IN_ORDER


def test_a_topic_of_two_types_names_both(tmp_path):
    path = tmp_path / 'b.mcap'
    with path.open('wb') as out:
        writer = Writer(out)
        writer.start('ros2', 'another recorder')
        for number, kind in enumerate(['a_msgs/msg/A', 'b_msgs/msg/B']):
            schema = writer.register_schema(kind, 'ros2msg', b'')
            channel = writer.register_channel('/a', 'cdr', schema)
            writer.add_message(channel, number, b'', number)
        writer.finish()
    with BagReader(path) as reader:
        assert reader.topics['/a'].type == 'a_msgs/msg/A, b_msgs/msg/B'
        assert reader.topics['/a'].count == 2
        assert reader.topics['/a'].qos == []


def test_another_encoding_is_named(tmp_path):
    path = tmp_path / 'b.mcap'
    with path.open('wb') as out:
        writer = Writer(out)
        writer.start('', 'another recorder')
        writer.add_message(writer.register_channel('/a', 'json', 0), 5, b'{}', 5)
        writer.finish()
    with BagReader(path) as reader:
        assert reader.topics['/a'].encoding == 'json'
        assert reader.topics['/a'].type == ''
    assert read(path) == [('/a', 5, b'{}')]
