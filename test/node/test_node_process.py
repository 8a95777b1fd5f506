"""The programs in processes of their own, over real Fast DDS: starts, faults and ends."""

from __future__ import annotations

import signal
from pathlib import Path

import pytest
from mcap.exceptions import EndOfFile
from mcap.reader import make_reader
from mcap.records import Message
from mcap.stream_reader import StreamReader
from mcap_ros2.decoder import DecoderFactory
from node.ros_values import PERIOD, ns
from rcl_interfaces.msg import Parameter, ParameterValue
from rcl_interfaces.srv import SetParameters
from rosbags.highlevel import AnyReader

# With this the first line on stdout tells that the node runs; it needs no discovery.
TELL = ('-p', 'live_line:=true')
RUNNING = 'cube_sim runs'


def errors_of(process):
    """The lines of the log that are errors."""
    return [line for line in process.errors.splitlines() if '[ERROR]' in line]


def check_bag(path, poses_at_least):
    """A whole bag, as rosbags and mcap_ros2 read it."""
    path = Path(path)
    assert (path / 'metadata.yaml').is_file()
    with AnyReader([path]) as reader:
        stamps = [
            ns(reader.deserialize(data, link.msgtype))
            for link, _, data in reader.messages()
            if link.topic == '/cube_sim/poses'
        ]
        total = reader.message_count
    assert len(stamps) >= poses_at_least
    assert stamps == [PERIOD * n for n in range(1, len(stamps) + 1)]
    with (path / f'{path.name}_0.mcap').open('rb') as stream:
        decoded = list(
            make_reader(
                stream, validate_crcs=True, decoder_factories=[DecoderFactory()]
            ).iter_decoded_messages()
        )
    assert len(decoded) == total
    found = [message for _, channel, _, message in decoded if channel.topic == '/cube_sim/poses']
    assert [ns(message) for message in found] == stamps
    return found


def bag_of(process):
    """The path that the process has printed at its end."""
    (line,) = (line for line in process.output.splitlines() if line.startswith('bag: '))
    return line.removeprefix('bag: ')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_the_node_cleanly_with_a_whole_bag(ros, sim_process, number, tmp_path):
    process = sim_process('-p', 'record:=true', '-p', 'bag_directory:=bags')
    poses = ros.listen('poses')
    poses.wait_for()
    assert ros.do('throw') == '0'
    poses.wait_for(lambda message: len(message.poses) == 1)
    process.send(number)
    assert process.wait() == 0
    path = tmp_path / bag_of(process)
    assert path.parent == tmp_path / 'bags'
    found = check_bag(path, len(poses.messages))
    assert len(found[-1].poses) == 1
    assert process.errors == ''


def test_more_signals_during_the_end_do_no_harm(sim_process, tmp_path):
    process = sim_process(*TELL, '-p', 'record:=true', '-p', 'scenario:=first_throws')
    process.wait_for_line(RUNNING)
    process.interrupt()
    process.send(signal.SIGTERM)
    process.interrupt()
    assert process.wait() == 0
    check_bag(tmp_path / bag_of(process), 0)


def test_a_killed_node_leaves_a_file_that_can_be_read(ros, sim_process, tmp_path):
    process = sim_process('-p', 'record:=true')
    poses = ros.listen('poses')
    poses.wait_for()
    ros.do('throw')
    first = ns(poses.wait_for(lambda message: len(message.poses) == 1))
    # What the recorder holds back is at most half a second of the clock; this is four times that.
    poses.wait_for(lambda message: ns(message) >= first + 2_000_000_000)
    process.kill()
    (file,) = tmp_path.glob('cube_sim_*/*.mcap')
    assert not (file.parent / 'metadata.yaml').exists()
    times = []
    with file.open('rb') as stream, pytest.raises(EndOfFile):
        for record in StreamReader(stream, validate_crcs=True).records:
            if isinstance(record, Message):
                times.append(record.log_time)
    assert times == sorted(times)
    assert times[-1] >= first


def test_malformed_ros_arguments_are_one_line_and_exit_code_2(sim_process):
    process = sim_process('-p', 'restitution')
    assert process.wait() == 2
    (line,) = process.errors.splitlines()
    assert line.startswith('sim_node: ')
    assert 'restitution' in line


def test_faults_in_scenario_and_parameters_are_one_error_each_and_the_node_runs(
    sim_process, tmp_path
):
    (tmp_path / 'typo.yaml').write_text('- {at: 0.0, throw: {}}\n- {at: 1.0, thow: {}}\n')
    process = sim_process(
        *TELL, '-p', 'scenario:=typo.yaml', '-p', 'restitution:=1.5', '-p', 'max_cubes:=many'
    )
    process.wait_for_line(RUNNING)
    process.wait_for_line('real-time factor')
    process.interrupt()
    assert process.wait() == 0
    errors = errors_of(process)
    assert len(errors) == len(process.errors.splitlines()) == 3
    (typo,) = (line for line in errors if 'typo.yaml' in line)
    assert "typo.yaml:2: an entry has no 'thow'" in typo
    assert 'allowed: at, camera, throw, set, reset' in typo
    (range_error,) = (line for line in errors if 'restitution is 1.5' in line)
    assert 'from 0 to 1' in range_error
    assert any('max_cubes is' in line and 'whole number' in line for line in errors)


def test_after_its_duration_the_process_ends_by_itself_faster_than_time(sim_process, tmp_path):
    # At the pace of the clock this would take a hundred minutes.
    process = sim_process(
        '-p', 'duration:=6000.0', '-p', 'real_time_factor:=0', '-p', 'publish_rate:=1'
    )
    assert process.wait() == 0
    assert (process.output, process.errors) == ('', '')


def test_a_recording_of_a_given_duration_is_whole(sim_process, tmp_path):
    process = sim_process(
        *('-p', 'duration:=2.0', '-p', 'real_time_factor:=0', '-p', 'record:=true'),
        *('-p', 'scenario:=first_throws'),
    )
    assert process.wait() == 0
    found = check_bag(tmp_path / bag_of(process), 100)
    assert len(found) == 100
    assert [len(message.poses) for message in (found[9], found[10], found[99])] == [0, 1, 4]


def test_cubes_can_be_thrown_without_the_ros2_command(ros, sim, run_module):
    simulator = sim(start_paused=True)
    process = run_module('cube_sim.node.throw', '2')
    assert process.wait() == 0
    assert process.output.splitlines() == ['cube 0', 'cube 1']
    assert process.errors == ''
    assert len(simulator.simulation.world) == 2


def test_throwing_says_why_a_throw_is_refused(ros, sim, run_module):
    sim(start_paused=True, max_cubes=1)
    process = run_module('cube_sim.node.throw', '3')
    assert process.wait() == 1
    assert process.output == 'cube 0\n'
    assert process.errors.startswith('There are 1 cubes already')


def test_throwing_says_so_when_no_simulator_answers(run_module):
    process = run_module('cube_sim.node.throw')
    assert process.wait() == 1
    assert process.output == ''
    assert process.errors.startswith('No simulator answers on /cube_sim/throw')


@pytest.mark.parametrize('arguments', [['some'], ['1', '2'], ['-1']])
def test_throwing_tells_its_usage(run_module, arguments):
    process = run_module('cube_sim.node.throw', *arguments)
    assert process.wait() == 2
    assert process.errors.startswith('usage: ')


def test_a_request_that_rclpy_cannot_read_does_not_make_the_node_deaf(ros, sim_process):
    process = sim_process()
    ros.listen('poses').wait_for()
    ros.do('throw')
    client = ros.node.create_client(SetParameters, '/cube_sim/set_parameters')
    assert client.wait_for_service(10)
    # No type has this number.
    unreadable = Parameter(name='restitution', value=ParameterValue(type=99))
    client.call_async(SetParameters.Request(parameters=[unreadable]))
    process.wait_for_line('could not be served', 'stderr')
    assert ros.do('throw') == '1'
    process.interrupt()
    assert process.wait() == 0
    assert len(errors_of(process)) == 1
