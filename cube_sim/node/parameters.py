"""Every parameter of the node, declared once: type, default, range, unit and what it does."""

from __future__ import annotations

import array
import dataclasses
import difflib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, get_args

import rclpy.node
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.parameter import Parameter as RosParameter

from cube_sim.physics.models import MODELS
from cube_sim.physics.refusal import PhysicsError
from cube_sim.physics.settings import Quantity, Settings, checked_number
from cube_sim.recording import Compression
from cube_sim.simulation import Throwing
from cube_sim.simulation.camera import Camera
from cube_sim.simulation.parameters import (
    CHANGEABLE,
    PHYSICS,
    THROWING,
    nanoseconds,
    settings_with,
    throwing_with,
)

Value = bool | int | float | str | list[float]

COMPRESSIONS: tuple[str, ...] = get_args(Compression)
# Each file of a bag repeats the descriptions of all topics: smaller ones hold little else.
LEAST_OF_A_BAG_FILE = {'max_bag_size': 1_000_000, 'max_bag_duration': 1.0}


@dataclass(frozen=True)
class Parameter:
    """A parameter as `ros2 param describe` and the README show it."""

    name: str
    default: Value
    description: str
    unit: str = ''
    low: float | None = None
    high: float | None = None
    changeable: bool = False

    def descriptor(self) -> ParameterDescriptor:
        """Return what rclpy declares it with."""
        described = self.description + (f' [{self.unit}]' if self.unit else '')
        descriptor = ParameterDescriptor(
            name=self.name, description=described, read_only=not self.changeable
        )
        if self.low is None or self.high is None:
            return descriptor
        if isinstance(self.default, int):
            descriptor.integer_range = [
                IntegerRange(from_value=int(self.low), to_value=int(self.high), step=1)
            ]
        elif isinstance(self.default, float):
            descriptor.floating_point_range = [
                FloatingPointRange(from_value=self.low, to_value=self.high, step=0.0)
            ]
        return descriptor

    def converted(self, value: Any) -> Any:
        """Return `value` with whole numbers made floats where floats are meant."""
        if isinstance(self.default, float) and type(value) is int:
            return float(value)
        if (
            isinstance(self.default, list)
            and isinstance(value, (Sequence, array.array))
            and all(isinstance(item, (int, float)) and type(item) is not bool for item in value)
        ):
            return [float(item) for item in value]
        return value


def _of_record(name: str, field_name: str, record: Any) -> Parameter:
    field = record.__dataclass_fields__[field_name]
    declared: Quantity = field.metadata['quantity']
    default = list(field.default) if isinstance(field.default, tuple) else field.default
    return Parameter(
        name,
        default,
        declared.effect,
        declared.unit,
        declared.low,
        declared.high,
        changeable=name in CHANGEABLE,
    )


def _physics_parameters() -> list[Parameter]:
    """Return the physics settings, under their ROS names, the time step in seconds."""
    found = []
    for name, field in PHYSICS.items():
        if name == 'physics_model':
            models = '; '.join(f'{model}: {MODELS[model].summary}' for model in MODELS)
            does = f'Response to contact. {models}'
            found.append(Parameter(name, Settings().model, does, changeable=True))
        elif name == 'time_step':
            step: Quantity = Settings.__dataclass_fields__[field].metadata['quantity']
            found.append(
                Parameter(
                    name,
                    Settings().time_step,
                    f'{step.effect}; a whole number of nanoseconds',
                    's',
                    step.low / 1e9,
                    step.high / 1e9,
                )
            )
        else:
            found.append(_of_record(name, field, Settings))
    return found


PARAMETERS: dict[str, Parameter] = {
    parameter.name: parameter
    for parameter in (
        *_physics_parameters(),
        *(_of_record(name, name, Throwing) for name in THROWING),
        Parameter(
            'publish_rate',
            50.0,
            'Publications per simulated second; the period is a whole number of steps',
            'Hz',
            0.01,
            1e6,
            changeable=True,
        ),
        Parameter(
            'real_time_factor',
            1.0,
            'Simulated seconds for each second of the clock; 0 runs as fast as it can',
            '',
            0.0,
            1000.0,
            changeable=True,
        ),
        Parameter('start_paused', False, 'Start with time standing still'),
        Parameter(
            'duration', 0.0, 'Simulated time after which the node ends; 0 is no end', 's', 0.0, 1e9
        ),
        Parameter(
            'scenario', '', 'YAML file of timed throws, settings and poses, or a packaged name'
        ),
        Parameter('record', False, 'Record a bag from the start'),
        Parameter('bag_directory', '.', 'Where bags are made; it is created when it is not there'),
        Parameter('bag_name', '', 'Name of the first bag; empty is one made of date and time'),
        Parameter('record_markers', False, 'Record the markers too', changeable=True),
        Parameter('bag_compression', 'none', f'How bags are compressed: {", ".join(COMPRESSIONS)}'),
        Parameter(
            'max_bag_size',
            0,
            'Size that no file of a bag exceeds, 1 MB or more; 0 is no limit',
            'bytes',
            0,
            2**50,
        ),
        Parameter(
            'max_bag_duration',
            0.0,
            'Simulated time after which a bag goes on in a new file, 1 s or more; 0 is no limit',
            's',
            0.0,
            1e9,
        ),
        Parameter('frame_id', 'world', 'Frame of everything that is published'),
        Parameter('publish_clock', True, 'Publish simulation time on /clock'),
        Parameter('camera.position', [0.0, 0.0, 1.5], 'Where the camera starts, x y z', 'm'),
        Parameter(
            'camera.orientation', [0.0, 0.0, 0.0, 1.0], 'How it is turned, quaternion x y z w'
        ),
        Parameter('live_line', False, 'Show time, cubes, model and factor in the terminal'),
    )
}


class ParameterError(ValueError):
    """A parameter value that is refused; the message says what would be right."""


def check(values: dict[str, Any], changes: dict[str, Any]) -> None:
    """
    Check `changes` of the parameters whose present values are `values`.

    Raises ParameterError for the first that cannot be, alone or together with the others.
    """
    for name, value in changes.items():
        _check_alone(PARAMETERS[name], value)
    after = {**values, **changes}
    try:
        settings_with(Settings(), {name: after[name] for name in PHYSICS})
        throwing_with(Throwing(), {name: after[name] for name in THROWING})
        Camera(after['camera.position'], after['camera.orientation'])
        steps_of_period(after['publish_rate'], nanoseconds(after['time_step']))
    except PhysicsError as error:
        raise ParameterError(str(error)) from None


def steps_of_period(publish_rate: float, time_step_ns: int) -> int:
    """Return the steps between publications; PhysicsError when they are no whole number."""
    steps = 1e9 / (publish_rate * time_step_ns)
    whole = max(1, round(steps))
    if abs(steps - whole) > 1e-9 * whole:
        fits = sorted(
            {1e9 / (n * time_step_ns) for n in (max(1, math.floor(steps)), whole)}
            | {1e9 / (math.ceil(steps) * time_step_ns)}
        )
        near = ' or '.join(f'{rate:g}' for rate in fits)
        raise PhysicsError(
            f'publish_rate is {publish_rate:g}: its period is {steps:g} steps of '
            f'{time_step_ns / 1e9:g} s, and a whole number is needed, as with {near} Hz.'
        )
    return whole


def _check_alone(parameter: Parameter, value: Any) -> None:
    name = parameter.name
    expected = type(parameter.default)
    right = type(value) is expected
    if right and expected is list:
        right = all(type(item) is float for item in value)
    if not right:
        words = {bool: 'true or false', int: 'a whole number', float: 'a number', str: 'text'}
        need = words.get(expected, 'a list of numbers')
        raise ParameterError(f'{name} is {value!r}: {need} is needed.')
    if name == 'bag_compression' and value not in COMPRESSIONS:
        raise ParameterError(f'{name} is {value!r}: choose one of {", ".join(COMPRESSIONS)}.')
    least = LEAST_OF_A_BAG_FILE.get(name, 0)
    if name in LEAST_OF_A_BAG_FILE and 0 < value < least:
        raise ParameterError(
            f'{name} is {value}: 0 or at least {least} {parameter.unit} is needed.'
        )
    if parameter.low is None or parameter.high is None or isinstance(value, (list, str)):
        return
    try:
        checked_number(name, value, Quantity(parameter.unit, parameter.low, parameter.high, ''))
    except PhysicsError as error:
        raise ParameterError(str(error)) from None


# What rclpy declares on every node.
_OF_RCLPY = ('use_sim_time', 'start_type_description_service')


def declare(node: rclpy.node.Node) -> dict[str, Any]:
    """
    Declare every parameter on `node`, and return the values.

    A value given at the start that cannot be is reported, and the default taken instead.
    """
    given = _given(node)
    values = {name: parameter.default for name, parameter in PARAMETERS.items()}
    # What needs the others comes together: a rate may fit only the step that is given with it.
    for group in (('time_step', 'publish_rate'), *((name,) for name in PARAMETERS)):
        changes = {name: given.pop(name) for name in group if name in given}
        try:
            check(values, changes)
        except ParameterError as error:
            kept = ', '.join(f'{name} stays {values[name]}' for name in changes)
            node.get_logger().error(f'{error} ({kept})')
        else:
            values.update(changes)
    for name, parameter in PARAMETERS.items():
        node.declare_parameter(name, values[name], parameter.descriptor(), ignore_override=True)
    return values


def _given(node: rclpy.node.Node) -> dict[str, Any]:
    """
    Return the values that command line and parameter files give, whatever their types.

    `node` has declared them all by itself; those of PARAMETERS are undeclared again here, and a
    name that nothing here goes by is reported.
    """
    given = {}
    for name in node.list_parameters([], 0).names:
        if name in PARAMETERS:
            given[name] = PARAMETERS[name].converted(node.get_parameter(name).value)
            node.undeclare_parameter(name)
        elif name not in _OF_RCLPY and not name.startswith('qos_overrides.'):
            near = difflib.get_close_matches(name, PARAMETERS, 1)
            hint = f' Is {near[0]} meant?' if near else ' `ros2 param list` shows those there are.'
            node.get_logger().warning(f'No parameter is called {name!r}; it is ignored.{hint}')
    return given


def as_ros(values: dict[str, Any]) -> list[RosParameter]:
    """Return values by name as rclpy's parameters."""
    return [
        RosParameter(name, value=list(value) if isinstance(value, tuple) else value)
        for name, value in values.items()
    ]


def markdown_table() -> str:
    """Return the table of the parameters as the README shows it."""
    rows = [
        '| parameter | default | unit | range | changes | what it does |',
        '|---|---|---|---|---|---|',
    ]
    for parameter in PARAMETERS.values():
        bounded = parameter.low is not None and parameter.high is not None
        span = f'{parameter.low:g} … {parameter.high:g}' if bounded else ''
        if parameter.name == 'physics_model':
            span = ', '.join(f'`{model}`' for model in MODELS)
        default = _shown(parameter.default)
        when = 'any time' if parameter.changeable else 'at start'
        rows.append(
            f'| `{parameter.name}` | {default} | {parameter.unit} | {span} | {when} '
            f'| {parameter.description} |'
        )
    return '\n'.join(rows)


def _shown(value: Value) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, list):
        return '[' + ', '.join(f'{item:g}' for item in value) + ']'
    return f'`{value}`' if isinstance(value, str) and value else f'{value}'


assert all(field.name in PARAMETERS for field in dataclasses.fields(Throwing))
