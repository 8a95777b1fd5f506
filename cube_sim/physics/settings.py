"""What a physics run can be told, each quantity declared once with its unit, range and effect."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from cube_sim.physics.constants import Constants
from cube_sim.physics.models import model_named
from cube_sim.physics.refusal import PhysicsError

__all__ = [
    'PhysicsError',
    'Quantity',
    'Settings',
    'checked_number',
    'checked_vector',
    'checked_whole',
    'quantity',
]

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Quantity:
    """The unit of a setting, the range in which it is meaningful, and what it does."""

    unit: str
    low: float
    high: float
    effect: str


def quantity(default: Any, unit: str, low: float, high: float, effect: str) -> Any:
    """Declare a field of a settings record, with its Quantity under the metadata of that name."""
    return dataclasses.field(
        default=default, metadata={'quantity': Quantity(unit, low, high, effect)}
    )


def switch(default: bool, effect: str) -> Any:
    """Declare a field that is true or false, with a Quantity that has no range."""
    none: Any = None
    return quantity(default, '', none, none, effect)


@dataclass(frozen=True)
class Settings:
    """
    All that the laws of motion and contact depend on, beside the state of the cubes.

    Checked when it is made: a value that is not finite or out of its range raises
    PhysicsError. `gravity_direction` is normalised when it merely is not of unit length.
    """

    model: str = 'simple'
    restitution: float = quantity(
        0.5, '', 0.0, 1.0, 'Share of the normal speed that a bounce gives back; 1 loses nothing'
    )
    friction: float = quantity(
        0.5, '', 0.0, 10.0, 'Friction coefficient of impulse and contact; 0: cubes slide for ever'
    )
    tangential_factor: float = quantity(
        0.9, '', 0.0, 1.0, 'Share of the sliding velocity that a bounce of the model simple keeps'
    )
    gravity: float = quantity(
        9.81, 'm/s^2', 0.0, 1000.0, 'Magnitude of the acceleration along gravity_direction'
    )
    gravity_direction: Vector = quantity(
        (0.0, 0.0, -1.0), '', -1.0, 1.0, 'Unit vector of gravity, world; turning it tilts the plane'
    )
    cube_size: float = quantity(
        0.5, 'm', 0.001, 100.0, 'Side of every cube; the mass stays 1 kg, the inertia is side^2/6'
    )
    time_step_ns: int = quantity(
        2_000_000, 'ns', 1_000, 100_000_000, 'Length of one step; the error of a path grows with it'
    )

    collide_cubes: bool = switch(True, 'Whether cubes of the model contact meet each other')
    restitution_threshold: float = quantity(
        0.02,
        'm/s',
        0.0,
        10.0,
        'Impacts of the model contact slower than this, times 1 - restitution^2, do not bounce',
    )
    sleep: bool = switch(True, 'Whether the model contact stops computing cubes that lie still')
    sleep_speed: float = quantity(
        0.01, 'm/s', 0.0, 10.0, 'Touching cubes fall asleep once all are slower than this'
    )
    sleep_delay: float = quantity(
        0.5, 's', 0.0, 3600.0, 'For how long they must have been slower than sleep_speed'
    )
    solver_substep: float = quantity(
        0.0011,
        's',
        1e-4,
        0.1,
        'Longest sub-step in which cubes that touch are solved; above 0.002, stacks tremble',
    )
    solver_effort: float = quantity(
        1.0,
        '',
        0.25,
        100.0,
        'Work on each sub-step: 4 times as many sweeps over what touches, up to 12 times more '
        'for small groups; below 1, high stacks sway',
    )

    def __post_init__(self) -> None:
        """Check every value; PhysicsError says which is wrong and what would be right."""
        model_named(self.model)
        for field in dataclasses.fields(self):
            declared = field.metadata.get('quantity')
            value = getattr(self, field.name)
            if declared and isinstance(field.default, bool):
                if not isinstance(value, bool):
                    raise PhysicsError(f'{field.name} is {value!r}: true or false is needed.')
            elif declared and field.name not in ('gravity_direction', 'time_step_ns'):
                number = checked_number(field.name, value, declared)
                object.__setattr__(self, field.name, number)
        if type(self.time_step_ns) is not int:
            raise PhysicsError(
                f'time_step_ns is {self.time_step_ns!r}: a whole number of nanoseconds is needed.'
            )
        checked_number('time_step_ns', self.time_step_ns, _declared('time_step_ns'))
        object.__setattr__(self, 'gravity_direction', _unit(self.gravity_direction))

    def changed(self, **changes: Any) -> Settings:
        """Return these settings with `changes`; PhysicsError names what cannot be."""
        for name in changes:
            if name not in self.__dataclass_fields__:
                known = ', '.join(self.__dataclass_fields__)
                raise PhysicsError(f'No setting is called {name!r}; there are: {known}.')
        return dataclasses.replace(self, **changes)

    @property
    def time_step(self) -> float:
        """The length of one step, s."""
        return self.time_step_ns / 1e9

    def constants(self) -> Constants:
        """Return what a step computes with, in the types of the compiled code."""
        dt = self.time_step
        x, y, z = self.gravity_direction
        return Constants(
            time_step=dt,
            gain_x=self.gravity * x * dt,
            gain_y=self.gravity * y * dt,
            gain_z=self.gravity * z * dt,
            half_side=0.5 * self.cube_size,
            inverse_inertia=6.0 / (self.cube_size * self.cube_size),
            restitution=self.restitution,
            friction=self.friction,
            tangential_factor=self.tangential_factor,
        )


def _declared(name: str) -> Quantity:
    declared: Quantity = Settings.__dataclass_fields__[name].metadata['quantity']
    return declared


def checked_number(name: str, value: object, declared: Quantity) -> float:
    """Return `value` as a float when it is a number in its range, else raise PhysicsError."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not declared.low <= value <= declared.high:  # type: ignore[operator]
        raise PhysicsError(f'{name} is {value!r}: a finite number {_range(declared)} is needed.')
    return float(value)  # type: ignore[arg-type]


def checked_whole(name: str, value: object, declared: Quantity) -> int:
    """Return `value` as an int when it is a whole number in its range, else raise PhysicsError."""
    number = checked_number(name, value, declared)
    if number != int(number):
        raise PhysicsError(f'{name} is {value!r}: a whole number {_range(declared)} is needed.')
    return int(number)


def checked_vector(name: str, value: Any, declared: Quantity) -> Vector:
    """Return `value` as three floats when each is in the range, else raise PhysicsError."""
    try:
        x, y, z = (float(component) for component in value)
    except (TypeError, ValueError):
        raise PhysicsError(f'{name} is {value!r}: three numbers x, y, z are needed.') from None
    if not all(declared.low <= component <= declared.high for component in (x, y, z)):
        raise PhysicsError(
            f'{name} is {[x, y, z]}: three finite numbers {_range(declared)} are needed.'
        )
    return (x, y, z)


def _range(declared: Quantity) -> str:
    unit = f' {declared.unit}' if declared.unit else ''
    return f'from {declared.low:g} to {declared.high:g}{unit}'


def _unit(direction: Any) -> Vector:
    x, y, z = checked_vector('gravity_direction', direction, Quantity('', -1e6, 1e6, ''))
    length = math.sqrt(x * x + y * y + z * z)
    if length < 1e-6:
        raise PhysicsError('gravity_direction is zero: a unit vector x, y, z is needed.')
    # A vector that is a unit vector to rounding keeps its bits, so that a recorded direction
    # read back is the very direction that was used.
    if abs(length - 1.0) < 1e-15:
        return (x, y, z)
    return (x / length, y / length, z / length)
