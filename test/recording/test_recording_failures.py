from __future__ import annotations

import contextlib
import errno
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from mcap.reader import make_reader

import cube_sim
from cube_sim.recording import BagWriter, RecordingError, Topic


@contextlib.contextmanager
def files_limited_to(size: int) -> Iterator[None]:
    """Let no file grow beyond `size` bytes: a full disk, as far as a writer can tell."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


class BrokenOutput:
    """A file whose writes fail half-way with an input/output error."""

    def __init__(self, out: Any) -> None:
        self._out = out

    def write(self, data: Any) -> int:
        self._out.write(data[: len(data) // 2])
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    def __getattr__(self, name: str) -> Any:
        return getattr(self._out, name)


def notes(path: Path) -> dict[str, str]:
    with (path / f'{path.name}_0.mcap').open('rb') as stream:
        records = make_reader(stream).iter_metadata()
        (found,) = [record.metadata for record in records if record.name == 'cube_sim']
    information = yaml.safe_load((path / 'metadata.yaml').read_text())
    assert information['rosbag2_bagfile_information']['custom_data'] == found
    return found


def test_an_existing_directory_is_not_overwritten(tmp_path, topics):
    (tmp_path / 'b').mkdir()
    with pytest.raises(RecordingError) as caught:
        BagWriter(tmp_path / 'b', topics)
    assert str(caught.value) == f'{tmp_path / "b"} exists already, not overwriting.'
    assert list((tmp_path / 'b').iterdir()) == []


def test_an_unwritable_place_is_one_clear_error(tmp_path, topics):
    (tmp_path / 'file').write_text('')
    with pytest.raises(RecordingError, match=r'cannot be created \(Not a directory\); choose a'):
        BagWriter(tmp_path / 'file' / 'deep' / 'b', topics)
    assert [path.name for path in tmp_path.iterdir()] == ['file']


def test_a_name_that_no_file_system_takes_is_one_clear_error(tmp_path, topics):
    with pytest.raises(RecordingError, match='cannot be created'):
        BagWriter(tmp_path / ('x' * 300), topics)
    with pytest.raises(RecordingError, match='cannot be created'):
        BagWriter(tmp_path / 'a\0b', topics)


def test_a_disk_that_is_full_from_the_start_leaves_nothing_behind(tmp_path, topics):
    with files_limited_to(1000), pytest.raises(RecordingError, match='File too large'):
        BagWriter(tmp_path / 'b', topics)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ('options', 'words'),
    [
        ({'compression': 'gzip'}, "'gzip' is unknown; choose one of none, lz4, zstd"),
        ({'chunk_size': 0}, 'chunk size of 0'),
    ],
)
def test_an_unknown_option_leaves_nothing_behind(tmp_path, topics, options, words):
    with pytest.raises(RecordingError, match=words):
        BagWriter(tmp_path / 'b', topics, **options)
    assert list(tmp_path.iterdir()) == []


def test_a_compression_that_is_not_installed_is_named(tmp_path, topics, monkeypatch):
    monkeypatch.setitem(sys.modules, 'zstandard', None)
    with pytest.raises(RecordingError, match='needs the Python package zstandard'):
        BagWriter(tmp_path / 'b', topics, compression='zstd')
    assert list(tmp_path.iterdir()) == []


def test_a_missing_definition_leaves_nothing_behind(tmp_path):
    with pytest.raises(RecordingError, match='ros-jazzy-no-such-msgs'):
        BagWriter(tmp_path / 'b', [Topic('/a', 'no_such_msgs/msg/Thing')])
    assert list(tmp_path.iterdir()) == []


def test_two_topics_of_one_name_are_refused(tmp_path, topics):
    with pytest.raises(RecordingError, match='same name'):
        BagWriter(tmp_path / 'b', [topics[0], topics[0]])


def test_a_full_disk_leaves_a_whole_bag_of_what_came_before(tmp_path, topics, make, read_bag):
    bag = BagWriter(tmp_path / 'b', topics, chunk_size=10_000)
    written = []
    with files_limited_to(400_000):
        while bag.error is None and len(written) < 10_000:
            written.append(('/cube_sim/poses', len(written), make.poses(len(written), 20)))
            with contextlib.suppress(RecordingError):
                bag.write(*written[-1])
        assert 'File too large' in bag.error
        with pytest.raises(RecordingError, match='stopped'):
            bag.write('/clock', 0, make.clock(0))
        with pytest.raises(RecordingError, match='stopped'):
            bag.flush()
        path = bag.close(drops=5)
    read = read_bag(path)
    assert read == written[: len(read)]
    assert 200_000 < sum(len(data) for _, _, data in read) == bag.bytes
    assert bag.messages == len(read)
    assert bag.lost == len(written) - len(read)
    assert notes(path)['drops'] == str(5 + bag.lost)
    assert 'File too large' in notes(path)['error']
    assert (path / 'b_0.mcap').stat().st_size <= 400_000
    assert {entry.name for entry in path.iterdir()} == {'b_0.mcap', 'metadata.yaml'}


def test_a_disk_that_fills_up_at_the_very_end_gives_up_a_few_messages(
    tmp_path, topics, make, read_bag
):
    bag = BagWriter(tmp_path / 'b', topics, chunk_size=10_000)
    written = [('/cube_sim/poses', time_ns, make.poses(time_ns, 20)) for time_ns in range(300)]
    for message in written:
        bag.write(*message)
    bag.flush()
    with files_limited_to((tmp_path / 'b' / 'b_0.mcap').stat().st_size + 100):
        path = bag.close()
    read = read_bag(path)
    assert read == written[: len(read)]
    assert 100 < len(read) < len(written)
    assert notes(path)['drops'] == str(len(written) - len(read)) == str(bag.lost)


def test_an_error_that_is_not_for_lack_of_room_costs_no_flushed_message(
    tmp_path, topics, make, read_bag
):
    bag = BagWriter(tmp_path / 'b', topics)
    bag.write('/clock', 1, make.clock(1))
    bag.flush()
    good = bag._file._out
    bag._file._out = BrokenOutput(good)
    bag.write('/clock', 2, make.clock(2))
    with pytest.raises(RecordingError, match='Input/output error'):
        bag.flush()
    assert (bag.messages, bag.lost) == (2, 0), 'the second one waits'
    bag._file._out = good
    assert [time_ns for _, time_ns, _ in read_bag(bag.close())] == [1, 2]


def test_a_disk_that_stays_broken_keeps_what_was_flushed(tmp_path, topics, make):
    bag = BagWriter(tmp_path / 'b', topics)
    bag.write('/clock', 1, make.clock(1))
    bag.flush()
    flushed = (tmp_path / 'b' / 'b_0.mcap').read_bytes()
    bag._file._out = BrokenOutput(bag._file._out)
    with pytest.raises(RecordingError, match=r'could not be finished \(Input/output error\)'):
        bag.close()
    assert (tmp_path / 'b' / 'b_0.mcap').read_bytes() == flushed
    assert [entry.name for entry in (tmp_path / 'b').iterdir()] == ['b_0.mcap']


@pytest.mark.parametrize('failures', [1, 2])
def test_without_room_for_metadata_yaml_messages_make_way_once(
    tmp_path, topics, make, monkeypatch, failures
):
    bag = BagWriter(tmp_path / 'b', topics, chunk_size=10_000)
    for time_ns in range(300):
        bag.write('/cube_sim/poses', time_ns, make.poses(time_ns, 20))
    write_bytes = Path.write_bytes
    errors = iter([OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))] * failures)

    def fail(path: Path, data: bytes) -> int:
        write_bytes(path, data[:10])
        for error in errors:
            raise error
        return write_bytes(path, data)

    monkeypatch.setattr(Path, 'write_bytes', fail)
    if failures == 1:
        assert notes(bag.close())['drops'] == str(bag.lost)
    else:
        with pytest.raises(RecordingError, match='could not be finished'):
            bag.close()
        assert [entry.name for entry in (tmp_path / 'b').iterdir()] == ['b_0.mcap']
    with (tmp_path / 'b' / 'b_0.mcap').open('rb') as stream:
        assert len(list(make_reader(stream).iter_messages())) == 300 - bag.lost == bag.messages
    assert 0 < bag.lost < 200


def test_a_killed_process_leaves_every_flushed_message(tmp_path, make, read_unfinished):
    code = f"""
import sys
from pathlib import Path
from cube_sim.recording import BagWriter, Topic
bag = BagWriter(Path({str(tmp_path / 'b')!r}), [Topic('/clock', 'rosgraph_msgs/msg/Clock')])
data = bytes.fromhex({make.clock(5).hex()!r})
for time_ns in range(30):
    bag.write('/clock', time_ns, data)
    if time_ns in (9, 19):
        bag.flush()
print('written', flush=True)
sys.stdin.read()
"""
    child = subprocess.Popen(
        [sys.executable, '-c', code],
        cwd=Path(cube_sim.__file__).parents[1],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    )
    with child:
        assert child.stdout.readline() == b'written\n'
        child.kill()
        assert child.wait(30) == -signal.SIGKILL
    assert read_unfinished(tmp_path / 'b' / 'b_0.mcap') == [
        (time_ns, make.clock(5)) for time_ns in range(20)
    ]
