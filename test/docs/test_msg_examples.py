"""Every file of msg_examples is a whole message, and its command is right."""

from __future__ import annotations

import importlib
import re
import shlex
from pathlib import Path
from typing import Any

import pytest
import yaml
from rclpy.serialization import deserialize_message, serialize_message
from support.collecting_outlet import CollectingOutlet

from cube_sim.node import parameters, topics
from cube_sim.physics import Settings
from cube_sim.simulation import Scenario, Simulation, Throwing
from cube_sim.simulation.camera import Camera

ROOT = Path(__file__).parents[2]
EXAMPLES = {path.stem: path for path in sorted((ROOT / 'msg_examples').iterdir())}
TOPICS = {
    topic.name.replace('~', '/cube_sim'): topic for topic in (*topics.PUBLISHED, *topics.SUBSCRIBED)
}
SUBSCRIBED = {topic.name for topic in topics.SUBSCRIBED}
PLAIN = {'boolean': bool, 'string': str, 'float': float, 'double': float}
WHOLE = re.compile(r'(u?)int(8|16|32|64)')
# Their colours are float32, which keep no float64 as it is.
COLORED = ('Marker', 'MarkerArray')


def content(name: str) -> Any:
    return yaml.safe_load(EXAMPLES[name].read_text(encoding='utf-8'))


def command(name: str) -> list[str]:
    """The words of the one command among the comments that begin the file."""
    lines = EXAMPLES[name].read_text(encoding='utf-8').splitlines()
    head = lines[: next(i for i, line in enumerate(lines) if not line.startswith('#'))]
    commands = [line for line in head if line.startswith('# ros2 ')]
    assert commands == head[-1:], f'{name}: the last comment of the head has to be the command'
    assert len(head) > 1, f'{name}: a sentence has to say what it is'
    return shlex.split(commands[0].removeprefix('# '))


def kind_named(name: str) -> Any:
    """The class of 'package/msg/Name', or the pair's for a service."""
    package, folder, short = name.split('/')
    return getattr(importlib.import_module(f'{package}.{folder}'), short)


def filled(kind: Any, value: Any, where: str = '') -> Any:
    """A message with every field from `value`; an AssertionError names what does not fit."""
    fields = kind.get_fields_and_field_types()
    assert isinstance(value, dict), f'{where}: fields are needed'
    assert set(value) == set(fields), f'{where}: {set(value) ^ set(fields)}'
    message = kind()
    for name, type_name in fields.items():
        setattr(message, name, field_value(type_name, value[name], f'{where}.{name}'))
    return message


def field_value(type_name: str, value: Any, where: str) -> Any:
    sequence = re.fullmatch(r'sequence<(.+)>|(.+)\[(\d+)\]', type_name)
    if sequence:
        element = sequence[1] or sequence[2]
        assert isinstance(value, list), f'{where}: a list is needed'
        assert sequence[3] is None or len(value) == int(sequence[3]), f'{where}: {len(value)} items'
        return [field_value(element, item, f'{where}[{i}]') for i, item in enumerate(value)]
    if type_name == 'octet':
        assert isinstance(value, str), f'{where}: a character is needed'
        assert len(value) == 1, f'{where}: one character is needed'
        return bytes([ord(value)])
    if type_name in PLAIN:
        assert type(value) is PLAIN[type_name], f'{where}: {value!r} is no {type_name}'
        return value
    whole = WHOLE.fullmatch(type_name)
    if whole:
        bits = int(whole[2])
        low, high = (0, 2**bits - 1) if whole[1] else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        assert type(value) is int, f'{where}: {value!r} is no {type_name}'
        assert low <= value <= high, f'{where}: {value!r} is no {type_name}'
        return value
    package, short = type_name.split('/')
    return filled(kind_named(f'{package}/msg/{short}'), value, where)


def round_trip(message: Any) -> Any:
    return deserialize_message(serialize_message(message), type(message))


def topic_example(name: str) -> tuple[Any, Any]:
    """The topic and the message of an example."""
    words = command(name)
    topic = TOPICS[words[-3 if words[2] == 'pub' else -2]]
    return topic, filled(topic.message, content(name), name)


FOR_TOPICS = [name for name in EXAMPLES if name.startswith('topic_')]
FOR_SERVICES = [name for name in EXAMPLES if name.startswith('service_')]


@pytest.mark.parametrize('name', FOR_TOPICS)
def test_an_example_of_a_topic_is_a_whole_message_of_the_type_in_its_command(name):
    topic, message = topic_example(name)
    words = command(name)
    if topic.name in SUBSCRIBED:
        assert words[:3] == ['ros2', 'topic', 'pub']
        assert words[-2] == topic.type_name
        assert yaml.safe_load(words[-1]) == content(name)
        assert words[3:-3] in (['--once'], ['--rate', '10'])
    else:
        late = ['--qos-reliability', 'reliable', '--qos-durability', 'transient_local']
        given = ['ros2', 'topic', 'echo', '--once', *(late if topic.latched else [])]
        assert words[:-2] == given
        assert words[-1] == topic.type_name
    again = round_trip(message)
    assert round_trip(again) == again
    if topic.message.__name__ not in COLORED:
        assert again == message


@pytest.mark.parametrize('name', FOR_SERVICES)
def test_an_example_of_a_service_is_a_whole_request_and_response(name):
    words = command(name)
    assert words[:3] == ['ros2', 'service', 'call']
    kind = kind_named(words[4])
    example = content(name)
    assert set(example) == {'request', 'response'}
    assert yaml.safe_load(words[5]) == example['request']
    for part, of in (('request', kind.Request), ('response', kind.Response)):
        message = filled(of, example[part], f'{name}.{part}')
        assert round_trip(message) == message


def test_every_topic_has_an_example():
    assert sorted(topic_example(name)[0].name for name in FOR_TOPICS) == sorted(
        topic.name for topic in TOPICS.values()
    )


def test_every_service_has_an_example_of_its_type(ros, sim):
    node = sim()
    served = ros.node.get_service_names_and_types_by_node(node.get_name(), node.get_namespace())
    ours = {name: kinds[0] for name, kinds in served if kinds[0].startswith('std_srvs')}
    assert ours == {command(name)[3]: command(name)[4] for name in FOR_SERVICES}


def test_there_are_no_other_files():
    assert set(EXAMPLES) == {*FOR_TOPICS, *FOR_SERVICES, 'param_set', 'param_file'}
    assert {path.suffix for path in EXAMPLES.values()} == {'.yaml'}


@pytest.mark.parametrize(
    ('kind', 'value'),
    [
        ('std_msgs/msg/Header', {'stamp': {'sec': 0, 'nanosec': 0}}),
        ('std_msgs/msg/Header', {'stamp': {'sec': 0, 'nanosec': 0}, 'frame_id': 3}),
        ('std_msgs/msg/Header', {'stamp': {'sec': 0.0, 'nanosec': 0}, 'frame_id': ''}),
        ('std_msgs/msg/Header', {'stamp': {'sec': 0, 'nanosec': -1}, 'frame_id': ''}),
        ('geometry_msgs/msg/Point', {'x': 0.0, 'y': 0.0, 'z': 0.0, 'w': 0.0}),
        ('geometry_msgs/msg/Point', {'x': 0, 'y': 0.0, 'z': 0.0}),
        ('geometry_msgs/msg/Polygon', {'points': {'x': 0.0, 'y': 0.0, 'z': 0.0}}),
        (
            'geometry_msgs/msg/PoseWithCovariance',
            {
                'pose': {
                    'position': {'x': 0.0, 'y': 0.0, 'z': 0.0},
                    'orientation': {'x': 0.0, 'y': 0.0, 'z': 0.0, 'w': 1.0},
                },
                'covariance': [0.0] * 35,
            },
        ),
    ],
)
def test_a_message_with_a_field_too_few_too_many_or_wrong_is_not_taken(kind, value):
    with pytest.raises(AssertionError):
        filled(kind_named(kind), value)


def test_what_the_node_sends_is_what_a_run_of_the_readmes_scenario_sends():
    readme = (ROOT / 'README.md').read_text(encoding='utf-8')
    scenario = re.search(r'^```yaml\n(.*?)^```$', readme, re.MULTILINE | re.DOTALL)
    assert scenario
    outlet = CollectingOutlet()
    run = Simulation(
        outlet, Settings(), Throwing(), camera=Camera(), scenario=Scenario.parse(scenario[1])
    )
    for _ in range(250):
        run.advance()
    for name in FOR_TOPICS:
        topic, message = topic_example(name)
        if topic.name in SUBSCRIBED or topic.name in (topics.DIAGNOSTICS, topics.CONTACTS):
            continue
        sent = [deserialize_message(data, topic.message) for _, data in outlet.of(topic.name)]
        if name == 'topic_ground':
            for ground in sent:
                ground.points, ground.colors = ground.points[:3], ground.colors[:3]
        assert round_trip(message) in sent, name


def test_the_example_of_contacts_is_of_a_cube_that_rests():
    outlet = CollectingOutlet()
    run = Simulation(outlet, Settings(model='contact'), Throwing(), camera=Camera())
    run.place_camera((0.0, 0.0, 0.25), (0.0, 0.0, 0.0, 1.0))
    run.throw(0.0, (0.0, 0.0, 0.0))
    for _ in range(100):
        run.advance()
    topic, message = topic_example('topic_contacts')
    sent = deserialize_message(outlet.of(topic.name)[-1][1], topic.message)
    assert len(sent.points) == 8
    sent.points = sent.points[:2]
    assert round_trip(message) == sent


def masked(text: str) -> str:
    """A message without its digits and without the directory of a path."""
    return re.sub(r'\d', '0', text.rsplit('/', 1)[-1])


def test_the_node_takes_what_the_examples_send_and_answers_what_they_show(ros, sim):
    sim()
    for service in ('pause', 'step', 'throw', 'next_model', 'reset', 'record'):
        name = f'service_{service}'
        kind, example = kind_named(command(name)[4]), content(name)
        answer = ros.request(kind, command(name)[3], kind.Request(**example['request']))
        assert answer.success == example['response']['success'], answer.message
        assert masked(answer.message) == masked(example['response']['message'])

    heard = ros.listen('camera/pose')
    _, place = topic_example('topic_camera_set_pose')
    ros.publisher('camera/set_pose').publish(place)
    heard.wait_for(lambda message: message.pose == place.pose)
    _, twist = topic_example('topic_camera_cmd_vel')
    ros.publisher('camera/cmd_vel').publish(twist)
    # It looks along world's y, and flies forward.
    heard.wait_for(lambda message: message.pose.position.y > 0.1)

    ((name, value),) = content('param_set').items()
    assert ros.set(name, value).successful
    assert ros.get(name) == [value]


def test_the_diagnostics_are_worded_as_in_their_example(ros, sim):
    heard = ros.listen('/diagnostics')
    # At a tenth of real time no machine is behind.
    sim(record=True, real_time_factor=0.1)
    found = heard.wait_for(lambda message: message.status[1].message == 'recording')
    _, example = topic_example('topic_diagnostics')
    for status, shown in zip(found.status, example.status, strict=True):
        assert (status.name, status.level, status.message) == (
            shown.name,
            shown.level,
            'recording' if 'recorder' in shown.name else 'running',
        )
        assert [pair.key for pair in status.values] == [pair.key for pair in shown.values]


def test_the_parameter_to_set_is_one_and_can_be_set():
    words = command('param_set')
    ((name, value),) = content('param_set').items()
    assert words[:4] == ['ros2', 'param', 'set', '/cube_sim']
    assert words[4] == name
    assert yaml.safe_load(words[5]) == value
    assert parameters.PARAMETERS[name].changeable
    parameters.check(defaults(), {name: value})


def test_the_parameter_file_has_every_parameter_and_is_accepted(sim):
    words = command('param_file')
    assert words[:4] == ['ros2', 'run', 'cube_sim', 'sim_node']
    assert words[4:6] == ['--ros-args', '--params-file']
    assert ROOT / words[6] == EXAMPLES['param_file']
    given = flat(content('param_file')['/cube_sim']['ros__parameters'])
    assert set(given) == set(parameters.PARAMETERS)
    parameters.check(defaults(), given)

    node = sim(options={'cli_args': [*words[4:6], str(EXAMPLES['param_file'])]})
    taken = {name: node.get_parameter(name).value for name in given if name != 'bag_directory'}
    assert taken == {name: given[name] for name in taken}


def defaults() -> dict[str, Any]:
    return {name: parameter.default for name, parameter in parameters.PARAMETERS.items()}


def flat(values: dict[str, Any], before: str = '') -> dict[str, Any]:
    """Nested parameters under their dotted names."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            found.update(flat(value, f'{before}{name}.'))
        else:
            found[f'{before}{name}'] = value
    return found
