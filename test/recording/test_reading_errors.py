from __future__ import annotations

import os
import shutil
import sqlite3
from pathlib import Path

import pytest
from support.foreign_bags import write_mcap, write_metadata

from cube_sim.recording import BagWriter, RecordingError
from cube_sim.recording.reader import BagReader

MESSAGES = [('/a', number, b'%d' % number) for number in range(20)]


@pytest.fixture
def bag(tmp_path):
    path = tmp_path / 'bag'
    path.mkdir()
    write_mcap(path / 'bag_0.mcap', MESSAGES)
    return write_metadata(path, ['bag_0.mcap'], MESSAGES)


def refusal(path: Path | str) -> str:
    with pytest.raises(RecordingError) as caught, BagReader(path) as reader:
        list(reader.messages())
    text = str(caught.value)
    assert '\n' not in text
    assert text.endswith('.')
    return text


def edit(bag: Path, old: str, new: str) -> None:
    path = bag / 'metadata.yaml'
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def test_a_path_that_does_not_exist(tmp_path):
    assert refusal(tmp_path / 'no') == (
        f'{tmp_path / "no"} does not exist; name a bag: its directory, or one .mcap file.'
    )
    assert 'does not exist' in refusal('a\0b')


def test_an_empty_file(tmp_path):
    (tmp_path / 'b.mcap').write_bytes(b'')
    assert 'is empty' in refusal(tmp_path / 'b.mcap')


def test_a_file_of_something_else(tmp_path):
    (tmp_path / 'notes.txt').write_text('This is no bag.')
    assert 'is not an MCAP file; name' in refusal(tmp_path / 'notes.txt')
    (tmp_path / 'b.mcap').write_text('This is no bag.' * 100)
    assert 'does not start as an MCAP file' in refusal(tmp_path / 'b.mcap')


def test_something_that_is_neither_file_nor_directory(tmp_path):
    os.mkfifo(tmp_path / 'pipe')
    assert 'neither a file nor a directory' in refusal(tmp_path / 'pipe')


def test_half_a_file(bag):
    path = bag / 'bag_0.mcap'
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    assert f'`cube_bag recover {bag}`' in refusal(bag)
    assert f'`cube_bag recover {path}`' in refusal(path)


def test_a_topic_that_the_bag_does_not_have(bag):
    with BagReader(bag) as reader, pytest.raises(RecordingError) as caught:
        reader.messages(['/cube_sim/poses'])
    assert str(caught.value) == f'{bag} has no topic /cube_sim/poses; it has /a.'


def test_a_recording_that_was_not_finished(tmp_path, topics):
    bag = BagWriter(tmp_path / 'b', topics)
    text = refusal(tmp_path / 'b')
    assert 'has no metadata.yaml, as when its recording still runs or was killed' in text
    assert f'`cube_bag recover {tmp_path / "b"}`' in text
    bag.close()


@pytest.mark.parametrize(
    'content',
    [
        b'', b'[', b'a: b: c', b'- 1', b'\xff\xfe\xfd', b'rosbag2_bagfile_information: 5',
        b'{' * 5000, b'? [a]\n: b', b'!!python/object:os.system {}', b'2001-99-99',
        b'0: &a [*a]', b'x: 1e999999', b'"\x00"',
    ],
)  # fmt: skip
def test_metadata_that_is_no_yaml_or_another(bag, content):
    (bag / 'metadata.yaml').write_bytes(content)
    text = refusal(bag)
    assert 'is not the description of a bag' in text
    assert f'`cube_bag recover {bag}`' in text


@pytest.mark.parametrize(
    ('old', 'new', 'words'),
    [
        ('- bag_0.mcap', '- bag_7.mcap', 'names the missing bag_7.mcap'),
        ('- bag_0.mcap', '- ../../bag_0.mcap/../x', 'names the missing x'),
        ('- bag_0.mcap', '- bag_0.mcap\n  - bag_0.mcap', 'names a file twice'),
        ('- bag_0.mcap', '- 5', 'does not list the files'),
        ('  relative_file_paths', '  relative_paths', 'does not list the files'),
        ('message_count: 20\n  topics', 'message_count: 19\n  topics', 'counts 19 messages'),
        ('message_count: 20\n  topics', 'message_count: many\n  topics', 'does not count'),
        ('storage_identifier: mcap', 'storage_identifier: tape', "names the storage 'tape'"),
        ("compression_mode: ''", 'compression_mode: FILE', "names the compression ''"),
        ("compression_mode: ''", 'custom_data: [1]', 'custom_data that are not pairs'),
        ('storage_identifier: mcap', 'storage_identifier: sqlite3', 'rosbags-convert'),
    ],
)
def test_metadata_that_does_not_fit_its_files(bag, old, new, words):
    edit(bag, old, new)
    assert words in refusal(bag)


@pytest.mark.skipif(os.geteuid() == 0, reason='root may read everything')
@pytest.mark.parametrize('name', ['', 'metadata.yaml', 'bag_0.mcap'])
def test_what_may_not_be_read(bag, name):
    path = bag / name
    path.chmod(0)
    try:
        assert 'Permission denied' in refusal(bag)
    finally:
        path.chmod(0o700)


def test_what_the_system_does_not_let_us_open(bag, monkeypatch):
    plain_open = Path.open

    def refuse(self, *arguments, **options):
        if self.suffix == '.mcap':
            raise PermissionError(13, 'Permission denied')
        return plain_open(self, *arguments, **options)

    monkeypatch.setattr(Path, 'open', refuse)
    assert 'cannot be read (Permission denied); check' in refusal(bag)


def test_a_file_that_goes_away_while_it_is_read(bag):
    with BagReader(bag) as reader:
        messages = reader.messages()
        (bag / 'bag_0.mcap').unlink()
        with pytest.raises(RecordingError, match='No such file'):
            list(messages)


def test_an_sqlite_bag_says_how_to_convert_it(tmp_path):
    bag = tmp_path / 'old'
    bag.mkdir()
    with sqlite3.connect(bag / 'old_0.db3') as data:
        data.execute('CREATE TABLE messages (id)')
    data.close()
    for path in (bag / 'old_0.db3', bag):
        assert f'`rosbags-convert --src {path} --dst' in refusal(path)
    shutil.copy(bag / 'old_0.db3', bag / 'x.mcap')
    assert 'is an SQLite bag' in refusal(bag / 'x.mcap')


def test_a_bag_of_ros_1_says_how_to_convert_it(tmp_path):
    (tmp_path / 'old.bag').write_bytes(b'#ROSBAG V2.0\n' + bytes(100))
    assert 'is a bag of ROS 1' in refusal(tmp_path / 'old.bag')


def test_a_directory_of_several_bags_names_them(bag):
    shutil.copytree(bag, bag.parent / 'two')
    assert 'is no bag but holds bag, two; name one of them' in refusal(bag.parent)


def test_a_directory_with_files_of_several_bags(bag):
    (bag / 'metadata.yaml').unlink()
    shutil.copy(bag / 'bag_0.mcap', bag / 'other.mcap')
    assert 'holds files of several bags (bag, other); name one file' in refusal(bag)


def test_a_directory_of_something_else(tmp_path):
    assert 'is no bag: it has neither metadata.yaml nor .mcap files' in refusal(tmp_path)


def test_a_file_of_a_split_bag_is_named_in_its_error(bag):
    write_mcap(bag / 'bag_1.mcap', MESSAGES)
    content = bytearray((bag / 'bag_1.mcap').read_bytes())
    content[content.index(b'19', 200)] ^= 4
    (bag / 'bag_1.mcap').write_bytes(content)
    write_metadata(bag, ['bag_0.mcap', 'bag_1.mcap'], MESSAGES * 2)
    assert 'bag_1.mcap' in refusal(bag)
