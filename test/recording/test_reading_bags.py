from __future__ import annotations

import tempfile
from pathlib import Path

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from rosbags.highlevel import AnyReader

from cube_sim.recording import BagWriter, RecordingError, Topic
from cube_sim.recording.merging import Part, RecordedMessage, in_order, merged
from cube_sim.recording.reader import BagReader, Gap


def read(path: Path, topics: list[str] | None = None) -> list[tuple[str, int, bytes]]:
    with BagReader(path) as reader:
        return [(topic, time, bytes(data)) for topic, time, data in reader.messages(topics)]


def fill(bag: BagWriter, make, steps: int = 20) -> list[tuple[str, int, bytes]]:
    written = [('/cube_sim/resets', 0, make.reset(0))]
    for step in range(steps):
        time_ns = step * 20_000_000
        written.append(('/clock', time_ns, make.clock(time_ns)))
        written.append(('/cube_sim/poses', time_ns, make.poses(time_ns, step)))
    for message in written:
        bag.write(*message)
    return written


@pytest.mark.parametrize('compression', ['none', 'lz4', 'zstd'])
def test_what_was_written_is_read_in_the_order_of_writing(tmp_path, topics, make, compression):
    with BagWriter(tmp_path / 'b', topics, compression=compression, chunk_size=2000) as bag:
        written = fill(bag, make)
    assert read(tmp_path / 'b') == written
    assert read(tmp_path / 'b' / 'b_0.mcap') == written


def test_both_readers_find_the_same_bag(tmp_path, topics, make, read_bag):
    with BagWriter(tmp_path / 'b', topics, chunk_size=2000) as bag:
        fill(bag, make)
    assert sorted(read(tmp_path / 'b')) == sorted(read_bag(tmp_path / 'b'))
    with AnyReader([tmp_path / 'b']) as theirs, BagReader(tmp_path / 'b') as ours:
        assert ours.message_count == theirs.message_count == 41
        assert ours.start_ns == theirs.start_time == 0
        # rosbags counts the end exclusively.
        assert ours.end_ns == theirs.end_time - 1 == 380_000_000
        assert {(topic.name, topic.type, topic.count) for topic in ours.topics.values()} == {
            (name, topic.msgtype, topic.msgcount) for name, topic in theirs.topics.items()
        }


def test_a_topic_says_what_the_writer_knew(tmp_path, topics, make):
    with BagWriter(tmp_path / 'b', topics) as bag:
        fill(bag, make)
    with BagReader(tmp_path / 'b') as reader:
        resets = reader.topics['/cube_sim/resets']
        assert reader.files == [tmp_path / 'b' / 'b_0.mcap']
        assert reader.path == tmp_path / 'b'
    assert (resets.name, resets.type, resets.count) == (
        '/cube_sim/resets', 'std_msgs/msg/Header', 1
    )  # fmt: skip
    assert 'MSG: builtin_interfaces/Time' in resets.definition
    (profile,) = resets.qos
    assert (profile['durability'], profile['depth']) == ('transient_local', 100)


def test_only_the_wanted_topics_are_read(tmp_path, topics, make):
    with BagWriter(tmp_path / 'b', topics, chunk_size=500) as bag:
        written = fill(bag, make)
    for wanted in (['/clock'], ['/cube_sim/resets', '/cube_sim/poses'], []):
        assert read(tmp_path / 'b', wanted) == [row for row in written if row[0] in wanted]


def test_chunks_without_a_wanted_topic_are_not_even_read(tmp_path, topics, make):
    with BagWriter(tmp_path / 'b', topics, chunk_size=500) as bag:
        fill(bag, make)
    path = tmp_path / 'b' / 'b_0.mcap'
    content = bytearray(path.read_bytes())
    place = content.rindex(make.poses(380_000_000, 19))
    content[place + 100] ^= 1
    path.write_bytes(content)
    assert len(read(tmp_path / 'b', ['/cube_sim/resets'])) == 1
    with pytest.raises(RecordingError, match='does not fit its checksum'):
        read(tmp_path / 'b', ['/cube_sim/poses'])


def test_an_empty_bag_is_read_as_empty(tmp_path, topics):
    path = BagWriter(tmp_path / 'b', topics).close()
    with BagReader(path) as reader:
        assert list(reader.messages()) == []
        assert (reader.message_count, reader.start_ns, reader.end_ns) == (0, 0, 0)
        assert {topic.count for topic in reader.topics.values()} == {0}


def test_split_files_are_one_bag(tmp_path, topics, make):
    with BagWriter(tmp_path / 'b', topics, chunk_size=500, max_duration_ns=50_000_000) as bag:
        written = fill(bag, make)
    with BagReader(tmp_path / 'b') as reader:
        assert len(reader.files) > 5
        assert reader.message_count == len(written)
        assert reader.topics['/clock'].count == 20
    assert read(tmp_path / 'b') == written
    second = read(tmp_path / 'b' / 'b_1.mcap')
    assert second == written[written.index(second[0]) :][: len(second)]


def test_drops_and_gaps_are_what_the_recorder_noted(tmp_path, topics, make):
    with BagWriter(tmp_path / 'b', topics) as bag:
        fill(bag, make)
        bag.drops.add(100, 200, {'/clock': 2, '/cube_sim/poses': 1})
        bag.drops.add(10**12, 10**12, {'/clock': 4})
        bag.drops.add_undated(5)
    for path in (tmp_path / 'b', tmp_path / 'b' / 'b_0.mcap'):
        with BagReader(path) as reader:
            assert reader.drops == 12
            assert reader.gaps == [Gap(100, 200, 3), Gap(10**12, 10**12, 4)]


@pytest.mark.parametrize('custom_data', [{'drops': '1'}, {}, None])
def test_drops_that_differ_from_place_to_place_are_refused(tmp_path, topics, make, custom_data):
    with BagWriter(tmp_path / 'b', topics) as bag:
        fill(bag, make)
    path = tmp_path / 'b' / 'metadata.yaml'
    content = yaml.safe_load(path.read_text())
    content['rosbag2_bagfile_information']['custom_data'] = custom_data
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(RecordingError, match='differs from place to place'):
        BagReader(tmp_path / 'b')


def test_a_closed_reader_says_so(tmp_path, topics):
    path = BagWriter(tmp_path / 'b', topics).close()
    with BagReader(path) as reader:
        pass
    with pytest.raises(RecordingError, match='is closed'):
        reader.messages()


def test_messages_out_of_order_are_read_in_order_of_time(tmp_path):
    with BagWriter(tmp_path / 'b', [Topic('/a', 'std_msgs/msg/Header')], chunk_size=60) as bag:
        for number, time_ns in enumerate([5, 3, 5, 9, 1, 5, 7, 3, 3]):
            bag.write('/a', time_ns, b'%d' % number)
    assert [(time, data) for _, time, data in read(tmp_path / 'b')] == [
        (1, b'4'), (3, b'1'), (3, b'7'), (3, b'8'), (5, b'0'), (5, b'2'), (5, b'5'), (7, b'6'),
        (9, b'3'),
    ]  # fmt: skip


@settings(max_examples=200, deadline=None)
@given(
    chunks=st.lists(st.lists(st.integers(0, 30), min_size=1, max_size=5), max_size=12),
    most_bytes=st.integers(0, 12),
)
def test_merged_chunks_are_one_stable_sort_whatever_fits_into_memory(chunks, most_bytes):
    number = iter(range(1000))
    content = [[RecordedMessage('/a', t, b'%d' % next(number)) for t in times] for times in chunks]
    parts = [
        Part(order, min(times), max(times), len(times), lambda rows=rows: in_order(rows))
        for order, (times, rows) in enumerate(zip(chunks, content, strict=True))
    ]
    everything = [message for rows in content for message in rows]
    assert list(merged(parts, most_bytes)) == sorted(everything, key=lambda row: row.time_ns)


def test_chunks_in_order_are_in_memory_one_after_the_other():
    alive = 0
    most = 0

    class Counted(list):
        def __init__(self, rows):
            nonlocal alive, most
            super().__init__(rows)
            alive += 1
            most = max(most, alive)

        def __del__(self):
            nonlocal alive
            alive -= 1

    def load(start):
        return Counted([RecordedMessage('/a', start + i, b'') for i in range(10)])

    parts = [Part(i, 9 * i, 9 * i + 9, 100, lambda i=i: load(9 * i)) for i in range(200)]
    assert sum(1 for _ in merged(parts)) == 2000
    assert most <= 3


def test_chunks_that_all_overlap_are_in_memory_up_to_the_bound():
    loads = []

    def load(number):
        loads.append(number)
        return [RecordedMessage('/a', 0, b''), RecordedMessage('/a', 10 + number, b'')]

    parts = [Part(i, 0, 10 + i, 10, lambda i=i: load(i)) for i in range(50)]
    assert [row.time_ns for row in merged(parts, 50)] == [0] * 50 + list(range(10, 60))
    assert len(loads) <= 2 * 50


@settings(max_examples=25, deadline=None)
@given(
    calls=st.lists(st.tuples(st.sampled_from(['/a', '/b']), st.integers(0, 9), st.binary())),
    chunk_size=st.integers(1, 200),
    compression=st.sampled_from(['none', 'lz4', 'zstd']),
)
def test_any_bag_is_read_as_a_stable_sort_of_what_was_written(calls, chunk_size, compression):
    topics = [Topic(name, 'std_msgs/msg/Header') for name in ('/a', '/b')]
    with tempfile.TemporaryDirectory() as folder:
        with BagWriter(
            Path(folder, 'b'), topics, chunk_size=chunk_size, compression=compression
        ) as bag:
            for call in calls:
                bag.write(*call)
        assert read(Path(folder, 'b')) == sorted(calls, key=lambda call: call[1])
