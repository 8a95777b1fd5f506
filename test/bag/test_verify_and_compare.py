"""`cube_bag verify`, `compare` and `recover` as they are called, and the bags of this project."""

from __future__ import annotations

import json
import math
import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from support.bags import TOPICS, record_run, throws

from cube_sim.analysis.verification import POSE_FIELDS
from cube_sim.bag.main import DIFFERS, DONE, REFUSED, main
from cube_sim.messages.decode import read_pose_array
from cube_sim.messages.poses import pose_array
from cube_sim.recording import BagWriter
from cube_sim.recording.reader import BagReader

BAGS = Path(__file__).parents[2] / 'bags'
POSES = '/cube_sim/poses'
THROWS = '/cube_sim/throws'


@pytest.fixture
def bag(tmp_path):
    return record_run(tmp_path / 'run', throws(3, every=0.1), 1.0, model='impulse')


def run(capsys, *arguments):
    """Run a command; return its exit code, what it printed, and its errors."""
    code = main([str(argument) for argument in arguments])
    out, err = capsys.readouterr()
    assert 'Traceback' not in err
    return code, out, err


def rewritten(source, target, change, *, dropped=None):
    """Copy a bag with `change(message) -> bytes or None` applied to each message."""
    with BagReader(source) as reader, BagWriter(target, TOPICS) as writer:
        for message in reader.messages():
            data = change(message)
            if data is not None:
                writer.write(message.topic, message.time_ns, bytes(data))
        if dropped is not None:
            writer.drops.add(*dropped)
    return target


@pytest.mark.parametrize('name', ['simple', 'impulse', 'contact', 'switch', 'reset'])
def test_a_bag_of_this_project_is_what_the_code_of_today_computes(capsys, name):
    code, out, _ = run(capsys, 'verify', BAGS / name)
    assert (code, out.strip()) == (DONE, 'verified: 200 messages, 0 differing bits')


def test_the_bags_of_this_project_hold_what_their_readme_says():
    with BagReader(BAGS / 'reset') as reader:
        assert reader.topics['/cube_sim/resets'].count == 1
        assert reader.topics['/cube_sim/markers'].count == 200
    with BagReader(BAGS / 'switch') as reader:
        assert reader.topics['/cube_sim/settings'].count == 4
    assert sum(file.stat().st_size for file in BAGS.rglob('*.mcap')) < 1_000_000
    assert not (BAGS / 'killed' / 'metadata.yaml').exists()


def test_the_killed_bag_is_refused_then_recovered_and_verified(capsys, tmp_path):
    code, _, err = run(capsys, 'verify', BAGS / 'killed')
    assert code == REFUSED
    assert 'cube_bag recover' in err
    code, out, _ = run(capsys, 'recover', BAGS / 'killed', '-o', tmp_path / 'whole')
    assert code == DONE
    assert str(tmp_path / 'whole') in out.replace('\n', '')
    code, out, _ = run(capsys, 'verify', tmp_path / 'whole')
    assert code == DONE
    assert ', 0 differing bits' in out


def test_one_changed_bit_is_found_and_named(bag, capsys, tmp_path):
    # The least significant bit of cube 1's orientation.y in the poses of 0.5 s.
    def change(message):
        if message.topic != POSES or message.time_ns != 500_000_000:
            return message.data
        array = read_pose_array(message.data)
        poses = np.array(array.poses)
        poses[1, 4] = np.nextafter(poses[1, 4], np.inf)
        return pose_array(array.time_ns, array.frame_id, poses)

    changed = rewritten(bag, tmp_path / 'changed', change)
    code, out, _ = run(capsys, 'verify', changed)
    assert code == DIFFERS
    assert 'first at 0.500000000 s, cube 1, orientation.y: recorded' in out
    code, out, _ = run(capsys, 'verify', '--json', changed)
    found = json.loads(out)
    assert found['verified'] is False
    assert found['differing_messages'] == 1
    assert found['first']['field'] == POSE_FIELDS[4]
    assert math.nextafter(found['first']['simulated'], math.inf) == found['first']['recorded']


def test_minus_zero_for_zero_is_a_difference(tmp_path, capsys):
    bag = record_run(tmp_path / 'run', '- {at: 0.0, throw: {speed: 0.0}}', 0.1)

    def change(message):
        if message.topic != POSES:
            return message.data
        array = read_pose_array(message.data)
        poses = np.array(array.poses)
        assert poses[0, 1] == 0.0
        poses[0, 1] = -0.0
        return pose_array(array.time_ns, array.frame_id, poses)

    code, out, _ = run(capsys, 'verify', rewritten(bag, tmp_path / 'changed', change))
    assert code == DIFFERS
    assert '5 messages, 5 differing bits in 5 messages' in out


def test_a_changed_throw_is_found(bag, capsys, tmp_path):
    def change(message):
        if message.topic != THROWS:
            return message.data
        data = bytearray(message.data)
        # The first number of the twist stands before 6 numbers of it and 36 of its covariance.
        place = len(data) - 8 * (6 + 36)
        (speed,) = struct.unpack_from('<d', data, place)
        assert speed > 1.0
        struct.pack_into('<d', data, place, math.nextafter(speed, 0.0))
        return bytes(data)

    code, _, _ = run(capsys, 'verify', rewritten(bag, tmp_path / 'changed', change))
    assert code == DIFFERS


def test_dropped_poses_are_named_and_not_missed(bag, capsys, tmp_path):
    def change(message):
        dropped = message.topic == POSES and 400_000_000 <= message.time_ns < 600_000_000
        return None if dropped else message.data

    gappy = rewritten(
        bag, tmp_path / 'gappy', change, dropped=(400_000_000, 580_000_000, {POSES: 10})
    )
    code, out, _ = run(capsys, 'verify', gappy)
    assert code == DONE
    assert 'dropped by the recorder: 10 messages from 0.400 s to 0.580 s' in out
    assert 'verified: 40 messages, 0 differing bits' in out


@pytest.mark.parametrize('known', [True, False])
def test_a_throw_that_was_not_recorded_ends_the_proof(bag, capsys, tmp_path, known):
    def change(message):
        is_second = message.topic == THROWS and message.time_ns == 100_000_000
        return None if is_second else message.data

    dropped = (100_000_000, 100_000_000, {THROWS: 1}) if known else None
    broken = rewritten(bag, tmp_path / 'broken', change, dropped=dropped)
    code, out, err = run(capsys, 'verify', broken)
    assert code == DIFFERS
    assert 'not recorded' in out
    assert err == ''


def test_a_bag_without_throws_cannot_be_verified(bag, capsys, tmp_path):
    only = rewritten(bag, tmp_path / 'only', lambda m: m.data if m.topic == POSES else None)
    code, out, err = run(capsys, 'verify', only)
    assert code in (DIFFERS, REFUSED)
    assert 'settings' in out + err


def test_a_bag_is_the_same_as_itself_recorded_again(capsys, tmp_path):
    bags = [record_run(tmp_path / name, throws(4), 1.0, model='simple') for name in 'ab']
    code, out, _ = run(capsys, 'compare', *bags)
    assert code == DONE
    assert 'the same run' in out


def test_two_models_part_at_the_first_bounce_and_not_before(capsys):
    code, out, _ = run(capsys, 'compare', '--json', BAGS / 'simple', BAGS / 'impulse')
    found = json.loads(out)
    assert code == DIFFERS
    assert found['common_messages'] == 200
    # Thrown level from 1.5 m a corner is down before 0.48 s: half a diagonal is 0.43 m.
    first = found['first_difference']['time_s']
    assert math.sqrt(2 * (1.5 - 0.4331) / 9.81) <= first <= math.sqrt(2 * (1.5 - 0.25) / 9.81)
    assert found['equal_messages'] == round(first * 50) - 1
    assert found['largest_distance_at_end_m'] > 0.1


def test_runs_of_other_lengths_and_numbers_of_cubes_are_told_apart(capsys, tmp_path):
    short = record_run(tmp_path / 'short', throws(2), 0.5)
    long = record_run(tmp_path / 'long', throws(3, every=0.2), 1.0)
    code, out, _ = run(capsys, 'compare', '--json', short, long)
    found = json.loads(out)
    assert code == DIFFERS
    assert found['only_in_second'] == 25
    assert found['different_numbers_of_cubes_from_s'] is not None


@pytest.mark.parametrize('suffix', ['.png', '.svg'])
def test_compare_draws_a_figure(capsys, tmp_path, suffix):
    figure = tmp_path / f'figure{suffix}'
    run(capsys, 'compare', BAGS / 'simple', BAGS / 'impulse', '--figure', figure)
    assert figure.read_bytes()[:5] in (b'\x89PNG\r', b'<?xml')


def test_a_figure_of_unknown_kind_is_refused(capsys, tmp_path):
    code, _, err = run(
        capsys, 'compare', BAGS / 'simple', BAGS / 'impulse', '--figure', tmp_path / 'f.nothing'
    )
    assert code == REFUSED
    assert err.count('\n') == 1


COMMANDS = [['report'], ['verify'], ['export'], ['compare', BAGS / 'simple']]


@pytest.mark.parametrize('command', COMMANDS, ids=lambda command: command[0])
@pytest.mark.parametrize('case', ['missing', 'empty', 'half', 'text', 'flipped', 'unfinished'])
def test_what_is_no_sound_bag_gets_one_sentence(capsys, tmp_path, command, case):
    path = tmp_path / case
    whole = BAGS / 'simple' / 'simple_0.mcap'
    if case == 'unfinished':
        shutil.copytree(BAGS / 'killed', path)
    elif case != 'missing':
        content = {
            'empty': b'',
            'half': whole.read_bytes()[: whole.stat().st_size // 2],
            'text': b'not a bag at all\n' * 20,
            'flipped': _flipped(whole.read_bytes()),
        }[case]
        path = path.with_suffix('.mcap')
        path.write_bytes(content)
    extra = ['--output', tmp_path / 'table.csv'] if command[0] == 'export' else []
    code, _, err = run(capsys, *command, path, *extra)
    assert code == REFUSED
    assert err.startswith('cube_bag: ')
    assert err.count('\n') == 1
    assert path.name in err


def _flipped(content):
    changed = bytearray(content)
    changed[len(changed) * 3 // 4] ^= 0x10
    return bytes(changed)


def test_a_topic_of_another_type_is_refused_with_those_that_fit(capsys):
    code, _, err = run(
        capsys, 'compare', BAGS / 'simple', BAGS / 'impulse', '--topic', '/cube_sim/throws'
    )
    assert code == REFUSED
    assert 'nav_msgs/msg/Odometry' in err
    assert POSES in err


def test_recover_says_when_there_is_nothing_to_be_had(capsys, tmp_path):
    nothing = tmp_path / 'nothing.mcap'
    nothing.write_bytes(b'\x00' * 1000)
    code, out, err = run(capsys, 'recover', nothing)
    assert code in (DIFFERS, REFUSED)
    assert out or err


def test_recover_never_overwrites(capsys, tmp_path):
    shutil.copytree(BAGS / 'killed', tmp_path / 'killed')
    (tmp_path / 'taken').mkdir()
    code, _, err = run(capsys, 'recover', tmp_path / 'killed', '-o', tmp_path / 'taken')
    assert code == REFUSED
    assert 'exists already' in err
    assert list((tmp_path / 'taken').iterdir()) == []
