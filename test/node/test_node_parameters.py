"""Parameters: declared as the contract says, set by the real services, refused with a reason."""

from __future__ import annotations

import math

import pytest
from node.ros_contract import DEFAULTS, PHYSICS
from node.ros_values import PERIOD, ns, settings_of
from rcl_interfaces.msg import Log, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter

from cube_sim.physics.models import MODELS

TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
    list: ParameterType.PARAMETER_DOUBLE_ARRAY,
}
FIXED = (
    'time_step',
    'start_paused',
    'duration',
    'scenario',
    'record',
    'bag_directory',
    'frame_id',
    'publish_clock',
    'camera.position',
    'camera.orientation',
)
TEXTS = ParameterValue(
    type=ParameterType.PARAMETER_STRING_ARRAY, string_array_value=['0', '0', '-1']
)
TRUTHS = ParameterValue(
    type=ParameterType.PARAMETER_BOOL_ARRAY, bool_array_value=[False, False, True]
)


def test_every_parameter_has_the_default_of_the_contract(ros, sim):
    sim(bag_directory='.')
    assert dict(zip(DEFAULTS, ros.get(*DEFAULTS), strict=True)) == DEFAULTS


def test_every_parameter_is_described_with_type_and_range(ros, sim):
    sim()
    for descriptor in ros.describe(*DEFAULTS):
        default = DEFAULTS[descriptor.name]
        assert descriptor.type == TYPES[type(default)], descriptor.name
        assert len(descriptor.description) > 15, descriptor.name
        if type(default) is float:
            (span,) = descriptor.floating_point_range
            assert span.from_value <= default <= span.to_value, descriptor.name
            assert math.isfinite(span.from_value)
            assert math.isfinite(span.to_value)
        if type(default) is int:
            (span,) = descriptor.integer_range
            assert (span.from_value, span.to_value) == (1, 1_000_000)
        assert descriptor.read_only == (descriptor.name in FIXED), descriptor.name


def test_the_models_that_can_be_chosen_are_described(ros, sim):
    sim()
    (descriptor,) = ros.describe('physics_model')
    assert all(model in descriptor.description for model in MODELS)


@pytest.mark.parametrize(
    ('name', 'value', 'held'),
    [
        ('physics_model', 'impulse', 'impulse'),
        ('restitution', 0.25, 0.25),
        ('restitution', 1, 1.0),
        ('friction', 0, 0.0),
        ('tangential_factor', 1.0, 1.0),
        ('gravity', 1.62, 1.62),
        ('gravity_direction', [0.6, 0.0, -0.8], [0.6, 0.0, -0.8]),
        ('gravity_direction', [0, 1, 0], [0.0, 1.0, 0.0]),
        ('gravity_direction', [0, 0, 2], [0.0, 0.0, 1.0]),
        ('cube_size', 0.125, 0.125),
    ],
)
def test_a_setting_is_taken_and_announced(ros, sim, name, value, held):
    sim(start_paused=True)
    settings = ros.listen('settings')
    ros.do('step')
    result = ros.set(name, value)
    assert result.successful, result.reason
    first, changed = settings.wait_for_count(2)
    assert ns(first.stamp) == 0
    assert ns(changed.stamp) == PERIOD
    assert first.node == changed.node == '/cube_sim'
    assert set(settings_of(first)) == set(settings_of(changed)) == set(PHYSICS)
    assert settings_of(changed) == {**settings_of(first), name: held}


def test_whole_numbers_that_are_set_are_shown_as_floats(ros, sim):
    sim()
    assert ros.set('restitution', 1).successful
    assert ros.set('throw_spin', [0, 0, 4]).successful
    values = ros.get('restitution', 'throw_spin')
    assert values == [1.0, [0.0, 0.0, 4.0]]
    assert type(values[0]) is float


def test_a_change_holds_from_the_next_step_on(ros, sim):
    sim({'camera.position': [0.0, 0.0, 50.0]}, start_paused=True)
    poses = ros.listen('poses')
    ros.do('throw')
    ros.do('step')
    assert ros.set('gravity', 0).successful
    for _ in range(3):
        ros.do('step')
    z = [message.poses[0].position.z for message in poses.wait_for_count(4)]
    speed = -9.81 * 0.02
    expected = [z[0] + speed * 0.02 * n for n in range(4)]
    assert z == pytest.approx(expected, abs=1e-12)


def test_setting_what_holds_already_announces_nothing(ros, sim):
    sim()
    settings = ros.listen('settings')
    assert ros.set('restitution', 0.5).successful
    assert ros.set('restitution', 0.75).successful
    assert [settings_of(message)['restitution'] for message in settings.wait_for_count(2)] == [
        0.5,
        0.75,
    ]


@pytest.mark.parametrize(
    ('name', 'value', 'right'),
    [
        ('restitution', math.nan, '1.0'),
        ('restitution', 1.5, '1.0'),
        ('restitution', -1e-9, '0'),
        ('restitution', 2, '1.0'),
        ('gravity', math.inf, '1000'),
        ('cube_size', 0.0, '0.001'),
        ('gravity_direction', [0.0, 0.0, 0.0], 'unit vector'),
        ('gravity_direction', [0.0, math.nan, 1.0], 'finite'),
        ('gravity_direction', [1.0, 0.0], 'three numbers'),
        ('gravity_direction', TEXTS, 'DOUBLE_ARRAY'),
        ('gravity_direction', TRUTHS, 'DOUBLE_ARRAY'),
        ('throw_spin', [0.0, 0.0, 1e9], '1000'),
        ('throw_speed', math.nan, '1000'),
        ('physics_model', 'magic', 'simple, impulse'),
        ('physics_model', 1, 'STRING'),
        ('restitution', 'high', 'DOUBLE'),
        ('restitution', True, 'DOUBLE'),
        ('restitution', None, 'cannot be undeclared'),
        ('max_cubes', 0, '1'),
        ('max_cubes', 2.5, 'INTEGER'),
        ('publish_rate', 400.0, '500 Hz'),
        ('publish_rate', 1000.0, '500 Hz'),
        ('publish_rate', 0.0, '0.01'),
        ('publish_rate', math.nan, '0.01'),
        ('real_time_factor', -1.0, '0.0'),
    ],
)
def test_a_bad_value_is_refused_with_what_is_right_and_changes_nothing(
    ros, sim, name, value, right
):
    simulator = sim(start_paused=True)
    settings = ros.listen('settings')
    before = simulator.simulation.parameters(), simulator.simulation.period_ns
    result = ros.set(name, value)
    assert not result.successful
    assert right in result.reason
    assert ros.get(name) == [DEFAULTS[name]]
    assert (simulator.simulation.parameters(), simulator.simulation.period_ns) == before
    # The next that comes is of the next change that is right.
    assert ros.set('friction', 0.125).successful
    assert [settings_of(message)['friction'] for message in settings.wait_for_count(2)] == [
        0.5,
        0.125,
    ]


@pytest.mark.parametrize('name', FIXED)
def test_what_is_fixed_at_the_start_is_read_only(ros, sim, name):
    sim(bag_directory='.')
    result = ros.set(name, DEFAULTS[name])
    assert not result.successful
    assert 'read-only' in result.reason


def test_a_parameter_that_does_not_exist_is_refused(ros, sim):
    sim()
    assert not ros.set('restituion', 0.5).successful
    ros.do('throw')


def test_of_parameters_set_together_all_are_taken_or_none(ros, sim):
    simulator = sim(start_paused=True)
    settings = ros.listen('settings')

    def set_together(**values):
        parameters = [Parameter(name, value=v).to_parameter_msg() for name, v in values.items()]
        request = SetParametersAtomically.Request(parameters=parameters)
        name = '/cube_sim/set_parameters_atomically'
        return ros.request(SetParametersAtomically, name, request).result

    assert not set_together(restitution=0.25, friction=math.nan).successful
    assert simulator.simulation.world.settings.restitution == 0.5
    assert set_together(restitution=0.25, friction=0.75, physics_model='impulse').successful
    changed = settings_of(settings.wait_for_count(2)[1])
    assert [changed[name] for name in ('restitution', 'friction', 'physics_model')] == [
        0.25,
        0.75,
        'impulse',
    ]
    assert len(settings.messages) == 2, 'one message for all of them'


@pytest.mark.parametrize(
    ('name', 'value', 'right'),
    [
        ('restitution', 2.0, 'from 0 to 1'),
        ('restitution', 'high', 'a number is needed'),
        ('restitution', math.nan, 'finite'),
        ('physics_model', 'magic', 'simple, impulse'),
        ('max_cubes', 0, 'from 1'),
        ('max_cubes', 2.0, 'a whole number'),
        ('publish_rate', 333.0, '500'),
        ('time_step', 0.0015000004, 'nanoseconds'),
        ('throw_spin', [1.0, 2.0], 'three numbers'),
        ('gravity_direction', ['0', '0', '-1'], 'numbers'),
        ('camera.orientation', [0.0, 0.0, 0.0, 0.0], 'quaternion'),
        ('camera.position', [0.0, math.inf, 0.0], 'finite'),
        ('start_paused', 1, 'true or false'),
        ('frame_id', 7, 'text'),
        ('duration', -1.0, 'from 0'),
    ],
)
def test_a_bad_value_at_the_start_is_one_error_and_the_default_is_used(
    ros, sim, name, value, right
):
    log = ros.listen('/rosout')
    sim({name: value})
    error = log.wait_for(lambda entry: entry.level == Log.ERROR)
    assert name.removeprefix('camera.') in error.msg
    assert right in error.msg
    assert 'stays' in error.msg
    assert ros.get(name) == [DEFAULTS[name]]
    ros.do('throw')
    assert len([entry for entry in log.messages if entry.level >= Log.ERROR]) == 1


def test_good_values_at_the_start_are_used_whole_numbers_too(ros, sim):
    simulator = sim(
        start_paused=True,
        restitution=1,
        gravity_direction=[0, 0, -1],
        time_step=0.001,
        publish_rate=1000,
        physics_model='impulse',
    )
    world = simulator.simulation.world
    assert (world.settings.restitution, world.settings.model) == (1.0, 'impulse')
    assert world.settings.time_step_ns == 1_000_000
    assert simulator.simulation.period_ns == 1_000_000
    assert ros.get('gravity_direction', 'publish_rate') == [[0.0, 0.0, -1.0], 1000.0]


def test_a_new_publish_rate_holds_from_the_next_publication_on(ros, sim):
    sim(start_paused=True)
    poses = ros.listen('poses')
    ros.do('step')
    assert ros.set('publish_rate', 500).successful
    ros.do('step')
    assert ros.set('publish_rate', 10.0).successful
    ros.do('step')
    stamps = [ns(message) for message in poses.wait_for_count(3)]
    assert stamps == [20_000_000, 22_000_000, 122_000_000]


def test_the_real_time_factor_can_be_changed_while_it_runs(ros, sim):
    simulator = sim(real_time_factor=0.001)
    poses = ros.listen('poses')
    # A period takes 20 s now; the wait would end the test.
    assert ros.set('real_time_factor', 0).successful
    poses.wait_for_count(50)
    assert simulator.runner.real_time_factor == 0.0
