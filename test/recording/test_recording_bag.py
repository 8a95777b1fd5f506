from __future__ import annotations

import dataclasses
import re
import struct
import tempfile
import zlib
from collections import Counter
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Chunk, Header, MessageIndex, Metadata
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader

from cube_sim import __version__
from cube_sim.recording import BagWriter, RecordingError, Topic, new_bag_path

INFINITE = {'sec': 9223372036, 'nsec': 854775807}


def plain(value: Any) -> Any:
    """Turn a message of either reader into dicts, lists and numbers."""
    if dataclasses.is_dataclass(value):
        fields = [field.name for field in dataclasses.fields(value)]
        return {name: plain(getattr(value, name)) for name in fields if name != '__msgtype__'}
    if hasattr(value, '__slots__'):
        return {name: plain(getattr(value, name)) for name in value.__slots__}
    if isinstance(value, list):
        return [plain(item) for item in value]
    return value


def fill(bag: BagWriter, make: Any, steps: int = 20) -> list[tuple[str, int, bytes]]:
    """Write a reset, then poses and clock per step; return what was written."""
    written = [('/cube_sim/resets', 0, make.reset(0))]
    for step in range(steps):
        time_ns = step * 20_000_000
        written.append(('/clock', time_ns, make.clock(time_ns)))
        written.append(('/cube_sim/poses', time_ns, make.poses(time_ns, step)))
    for message in written:
        bag.write(*message)
    return written


def by_topic(messages: list[tuple[str, int, bytes]]) -> list[tuple[str, int, bytes]]:
    return sorted(messages, key=lambda message: message[:2])


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_what_is_written_is_what_rosbags_reads(tmp_path, topics, make, read_bag, compression):
    with BagWriter(tmp_path / 'b', topics, compression=compression, chunk_size=2000) as bag:
        written = fill(bag, make)
    assert by_topic(read_bag(tmp_path / 'b')) == by_topic(written)


def test_both_readers_decode_the_same_values(tmp_path, topics, make):
    with BagWriter(tmp_path / 'b', topics) as bag:
        fill(bag, make)
    with AnyReader([tmp_path / 'b']) as reader:
        one = [
            (link.topic, time_ns, plain(reader.deserialize(data, link.msgtype)))
            for link, time_ns, data in reader.messages()
        ]
    with (tmp_path / 'b' / 'b_0.mcap').open('rb') as stream:
        two = [
            (channel.topic, message.log_time, plain(decoded))
            for _, channel, message, decoded in make_reader(
                stream, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages()
        ]
    assert by_topic(one) == by_topic(two)
    (last,) = [
        message
        for name, time_ns, message in one
        if (name, time_ns) == ('/cube_sim/poses', 380_000_000)
    ]
    assert last['header'] == {'stamp': {'sec': 0, 'nanosec': 380_000_000}, 'frame_id': 'world'}
    assert len(last['poses']) == 19
    assert last['poses'][2]['position'] == {'x': 0.38, 'y': -0.2, 'z': 1 / 3}
    assert last['poses'][2]['orientation'] == {'x': 0.0, 'y': 0.6, 'z': 0.0, 'w': -0.8}


def test_metadata_yaml_has_every_key(tmp_path, make):
    topic = Topic('/cube_sim/poses', 'geometry_msgs/msg/PoseArray', depth=3)
    with BagWriter(tmp_path / 'b', [topic]) as bag:
        for time_ns in (7_000, 5_000, 9_500):
            bag.write(topic.name, time_ns, make.poses(time_ns, 1))
    text = (tmp_path / 'b' / 'metadata.yaml').read_text()
    assert yaml.safe_load(text) == {
        'rosbag2_bagfile_information': {
            'version': 9,
            'storage_identifier': 'mcap',
            'duration': {'nanoseconds': 4_500},
            'starting_time': {'nanoseconds_since_epoch': 5_000},
            'message_count': 3,
            'topics_with_message_count': [
                {
                    'topic_metadata': {
                        'name': '/cube_sim/poses',
                        'type': 'geometry_msgs/msg/PoseArray',
                        'serialization_format': 'cdr',
                        'offered_qos_profiles': [
                            {
                                'history': 'keep_last',
                                'depth': 3,
                                'reliability': 'reliable',
                                'durability': 'volatile',
                                'deadline': INFINITE,
                                'lifespan': INFINITE,
                                'liveliness': 'automatic',
                                'liveliness_lease_duration': INFINITE,
                                'avoid_ros_namespace_conventions': False,
                            }
                        ],
                        'type_description_hash': (
                            'RIHS01_af0cc36d190e104d546d168d6b39df04'
                            'fa4b4ccecf59cb4c9ed328d3d5004aa0'
                        ),
                    },
                    'message_count': 3,
                }
            ],
            'compression_format': '',
            'compression_mode': '',
            'relative_file_paths': ['b_0.mcap'],
            'files': [
                {
                    'path': 'b_0.mcap',
                    'starting_time': {'nanoseconds_since_epoch': 5_000},
                    'duration': {'nanoseconds': 4_500},
                    'message_count': 3,
                }
            ],
            'custom_data': {'drops': '0'},
            'ros_distro': 'jazzy',
        }
    }
    assert not re.search(r'[&*]id\d', text), 'an alias'


def test_the_file_agrees_with_metadata_yaml_and_with_itself(tmp_path, topics, make):
    with BagWriter(tmp_path / 'b', topics, chunk_size=2000) as bag:
        written = fill(bag, make)
    path = tmp_path / 'b' / 'b_0.mcap'
    information = yaml.safe_load((tmp_path / 'b' / 'metadata.yaml').read_text())
    information = information['rosbag2_bagfile_information']
    with path.open('rb') as stream:
        reader = make_reader(stream, validate_crcs=True)
        summary = reader.get_summary()
        read = [
            (channel.topic, message.log_time, message.data)
            for _, channel, message in reader.iter_messages(log_time_order=False)
        ]
        notes = [(record.name, record.metadata) for record in reader.iter_metadata()]
    assert read == written
    counts = Counter(name for name, _, _ in written)
    assert {
        row['topic_metadata']['name']: row['message_count']
        for row in information['topics_with_message_count']
    } == counts
    assert summary.statistics.message_count == information['message_count'] == len(written)
    assert summary.statistics.message_start_time == 0
    assert summary.statistics.message_end_time == information['duration']['nanoseconds']
    assert summary.statistics.chunk_count == len(summary.chunk_indexes) > 3
    assert summary.statistics.schema_count == summary.statistics.channel_count == 3
    by_name = {channel.topic: channel for channel in summary.channels.values()}
    assert {
        by_name[name].id: count for name, count in counts.items()
    } == summary.statistics.channel_message_counts
    for row in information['topics_with_message_count']:
        channel = by_name[row['topic_metadata']['name']]
        assert channel.message_encoding == 'cdr'
        assert summary.schemas[channel.schema_id].name == row['topic_metadata']['type']
        assert summary.schemas[channel.schema_id].encoding == 'ros2msg'
        assert channel.metadata['topic_type_hash'] == row['topic_metadata']['type_description_hash']
        qos = yaml.safe_load(channel.metadata['offered_qos_profiles'])
        assert qos == row['topic_metadata']['offered_qos_profiles']
    assert [name for name, _ in notes] == ['rosbag2', 'rosbag2', 'cube_sim']
    assert yaml.safe_load(notes[0][1]['serialized_metadata'])['message_count'] == 0
    assert yaml.safe_load(notes[1][1]['serialized_metadata']) == information
    assert notes[2][1] == {'drops': '0'}


def test_every_offset_of_the_index_points_at_its_record(tmp_path, topics, make):
    with BagWriter(tmp_path / 'b', topics, chunk_size=2000) as bag:
        fill(bag, make)
    path = tmp_path / 'b' / 'b_0.mcap'
    data = path.read_bytes()

    def record_at(offset: int, length: int | None = None) -> Any:
        with path.open('rb') as stream:
            stream.seek(offset)
            record = next(StreamReader(stream, skip_magic=True, emit_chunks=True).records)
            assert length in (None, stream.tell() - offset)
            return record

    with path.open('rb') as stream:
        reader = make_reader(stream)
        header = reader.get_header()
        summary = reader.get_summary()
    assert header == Header('ros2', f'cube_sim {__version__}')
    for index in summary.chunk_indexes:
        chunk = record_at(index.chunk_start_offset, index.chunk_length)
        assert isinstance(chunk, Chunk)
        assert zlib.crc32(chunk.data) == chunk.uncompressed_crc
        end = index.chunk_start_offset + index.chunk_length + index.message_index_length
        assert max(index.message_index_offsets.values()) < end
        for channel_id, offset in index.message_index_offsets.items():
            rows = record_at(offset)
            assert isinstance(rows, MessageIndex)
            assert rows.channel_id == channel_id
            for log_time, start in rows.records:
                opcode, _, channel, _, time_ns = struct.unpack_from('<BQHIQ', chunk.data, start)
                assert (opcode, channel, time_ns) == (5, channel_id, log_time)
    for index in summary.metadata_indexes:
        note = record_at(index.offset, index.length)
        assert isinstance(note, Metadata)
        assert note.name == index.name
    summary_start, offsets_start, checksum = struct.unpack('<QQI', data[-28:-8])
    assert zlib.crc32(data[summary_start:-12]) == checksum
    at = offsets_start
    while data[at] == 0x0E:
        group_opcode, group_start, group_length = struct.unpack_from('<BQQ', data, at + 9)
        assert data[group_start] == group_opcode
        assert group_start + group_length <= offsets_start
        at += 9 + 17
    assert data[at] == 0x02


def test_an_empty_bag_is_whole(tmp_path, topics):
    path = BagWriter(tmp_path / 'b', topics).close()
    with AnyReader([path]) as reader:
        assert reader.message_count == 0
        assert {link.topic for link in reader.connections} == {topic.name for topic in topics}
        assert list(reader.messages()) == []
    information = yaml.safe_load((path / 'metadata.yaml').read_text())
    information = information['rosbag2_bagfile_information']
    assert information['message_count'] == 0
    assert information['duration'] == {'nanoseconds': 0}
    assert information['starting_time'] == {'nanoseconds_since_epoch': 2**63 - 1}
    assert information['files'][0]['message_count'] == 0


def test_two_topics_of_one_type_share_a_schema(tmp_path, make, read_bag):
    topics = [Topic(name, 'geometry_msgs/msg/PoseArray') for name in ('/a', '/b')]
    with BagWriter(tmp_path / 'b', topics) as bag:
        bag.write('/b', 1, make.poses(1, 2))
    with (tmp_path / 'b' / 'b_0.mcap').open('rb') as stream:
        assert len(make_reader(stream).get_summary().schemas) == 1
    assert read_bag(tmp_path / 'b') == [('/b', 1, make.poses(1, 2))]


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_the_same_calls_make_the_same_bytes(tmp_path, topics, make, compression):
    for parent in ('one', 'two'):
        with BagWriter(
            tmp_path / parent / 'b', topics, compression=compression, chunk_size=3000
        ) as bag:
            fill(bag, make)
            bag.flush()
            fill(bag, make, steps=3)
    for name in ('b_0.mcap', 'metadata.yaml'):
        assert (tmp_path / 'one/b' / name).read_bytes() == (tmp_path / 'two/b' / name).read_bytes()


@settings(max_examples=40, deadline=None)
@given(
    calls=st.lists(
        st.one_of(
            st.tuples(st.sampled_from(['/a', '/b']), st.integers(0, 2**63 - 1), st.binary()),
            st.just('flush'),
        )
    ),
    chunk_size=st.integers(1, 300),
)
def test_any_sequence_of_calls_comes_back_in_order(calls, chunk_size):
    topics = [Topic(name, 'std_msgs/msg/Header') for name in ('/a', '/b')]
    written = [call for call in calls if call != 'flush']
    with tempfile.TemporaryDirectory() as folder:
        with BagWriter(Path(folder, 'b'), topics, chunk_size=chunk_size) as bag:
            for call in calls:
                if call == 'flush':
                    bag.flush()
                else:
                    bag.write(*call)
            assert bag.messages == len(written)
            assert bag.bytes == sum(len(data) for _, _, data in written)
        with Path(folder, 'b', 'b_0.mcap').open('rb') as stream:
            reader = make_reader(stream, validate_crcs=True)
            statistics = reader.get_summary().statistics
            found = list(reader.iter_messages(log_time_order=False))
        information = yaml.safe_load(Path(folder, 'b', 'metadata.yaml').read_text())
    assert [(channel.topic, row.log_time, row.data) for _, channel, row in found] == written
    assert all(row.publish_time == row.log_time for _, _, row in found)
    assert statistics.message_count == len(written)
    assert information['rosbag2_bagfile_information']['message_count'] == len(written)


def test_a_file_that_was_never_closed_holds_what_was_flushed(tmp_path, topics, make):
    bag = BagWriter(tmp_path / 'b', topics)
    path = tmp_path / 'b' / 'b_0.mcap'
    head = path.read_bytes()
    assert all(topic.name.encode() in head for topic in topics), 'not even the topics'
    bag.write('/clock', 1, make.clock(1))
    assert path.read_bytes() == head
    bag.flush()
    assert make.clock(1) in path.read_bytes()
    assert not (tmp_path / 'b' / 'metadata.yaml').exists()
    bag.close()


def test_closing_twice_changes_nothing(tmp_path, topics, make):
    bag = BagWriter(tmp_path / 'b', topics)
    fill(bag, make)
    assert bag.close(drops=3) == tmp_path / 'b'
    before = {path.name: path.read_bytes() for path in (tmp_path / 'b').iterdir()}
    assert bag.close(drops=5) == tmp_path / 'b'
    assert {path.name: path.read_bytes() for path in (tmp_path / 'b').iterdir()} == before
    assert set(before) == {'b_0.mcap', 'metadata.yaml'}
    with pytest.raises(RecordingError, match='is closed'):
        bag.write('/clock', 1, b'')


@pytest.mark.parametrize(
    ('message', 'words'),
    [
        (('/nowhere', 0, b''), 'it has /clock, /cube_sim/poses, /cube_sim/resets'),
        (('/clock', -1, b''), 'log time of -1 ns'),
        (('/clock', 2**63, b''), 'log time of 9223372036854775808 ns'),
    ],
)
def test_a_message_that_cannot_be_in_the_bag_is_refused_alone(
    tmp_path, topics, make, read_bag, message, words
):
    with BagWriter(tmp_path / 'b', topics) as bag:
        bag.write('/clock', 1, make.clock(1))
        with pytest.raises(RecordingError, match=words):
            bag.write(*message)
        bag.write('/clock', 2, make.clock(2))
    assert [time_ns for _, time_ns, _ in read_bag(tmp_path / 'b')] == [1, 2]


def test_a_name_for_a_bag_is_its_time_and_is_free(tmp_path):
    moment = datetime(2025, 3, 4, 15, 6, 7, 890)
    first = new_bag_path(tmp_path, moment)
    assert first == tmp_path / 'cube_sim_2025_03_04-15_06_07'
    first.mkdir()
    second = new_bag_path(tmp_path, moment)
    assert second == tmp_path / 'cube_sim_2025_03_04-15_06_07_1'
    second.symlink_to(tmp_path / 'nothing')
    assert new_bag_path(tmp_path, moment).name == 'cube_sim_2025_03_04-15_06_07_2'
    assert new_bag_path(tmp_path, moment, 'pile').name == 'pile_2025_03_04-15_06_07'
