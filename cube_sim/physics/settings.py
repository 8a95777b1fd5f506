"""What a physics run can be told, each quantity declared once with its unit, range and effect."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from cube_sim.physics.constants import Constants
from cube_sim.physics.models import model_named
from cube_sim.physics.refusal import PhysicsError

__all__ = ['PhysicsError', 'Quantity', 'Settings', 'quantity_of']

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Quantity:
    """The unit of a setting, the range in which it is meaningful, and what it does."""

    unit: str
    low: float
    high: float
    effect: str


def _quantity(default: Any, unit: str, low: float, high: float, effect: str) -> Any:
    return dataclasses.field(
        default=default, metadata={'quantity': Quantity(unit, low, high, effect)}
    )


def quantity_of(name: str) -> Quantity:
    """Return what is declared of the numeric setting `name`."""
    quantity = Settings.__dataclass_fields__[name].metadata['quantity']
    assert isinstance(quantity, Quantity)
    return quantity


@dataclass(frozen=True)
class Settings:
    """
    All that the laws of motion and contact depend on, beside the state of the cubes.

    Checked when it is made: a value that is not finite or out of its range raises
    PhysicsError. `gravity_direction` is normalised when it merely is not of unit length.
    """

    model: str = 'simple'
    restitution: float = _quantity(
        0.5, '', 0.0, 1.0, 'Share of the normal speed that a bounce gives back; 1 loses nothing'
    )
    friction: float = _quantity(
        0.5, '', 0.0, 10.0, 'Coulomb coefficient of the model impulse; 0 lets cubes slide for ever'
    )
    tangential_factor: float = _quantity(
        0.9, '', 0.0, 1.0, 'Share of the sliding velocity that a bounce of the model simple keeps'
    )
    gravity: float = _quantity(
        9.81, 'm/s^2', 0.0, 1000.0, 'Magnitude of the acceleration along gravity_direction'
    )
    gravity_direction: Vector = _quantity(
        (0.0, 0.0, -1.0), '', -1.0, 1.0, 'Unit vector of gravity in world; turning it tilts the plane'
    )
    cube_size: float = _quantity(
        0.5, 'm', 0.001, 100.0, 'Side of every cube; the mass stays 1 kg, the inertia is side^2/6'
    )
    time_step_ns: int = _quantity(
        2_000_000, 'ns', 1_000, 100_000_000, 'Length of one step; the error of a path grows with it'
    )

    def __post_init__(self) -> None:
        """Check every value; PhysicsError says which is wrong and what would be right."""
        model_named(self.model)
        for field in dataclasses.fields(self):
            if 'quantity' in field.metadata and field.name != 'gravity_direction':
                _check(field.name, getattr(self, field.name), field.metadata['quantity'])
                if field.name != 'time_step_ns':
                    object.__setattr__(self, field.name, float(getattr(self, field.name)))
        if type(self.time_step_ns) is not int:
            raise PhysicsError(
                f'time_step_ns is {self.time_step_ns!r}: a whole number of nanoseconds is needed.'
            )
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


def _check(name: str, value: object, quantity: Quantity) -> None:
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if not number or not quantity.low <= value <= quantity.high:  # type: ignore[operator]
        unit = f' {quantity.unit}' if quantity.unit else ''
        raise PhysicsError(
            f'{name} is {value!r}: a finite number from {quantity.low:g} to {quantity.high:g}'
            f'{unit} is needed.'
        )


def _unit(direction: Any) -> Vector:
    try:
        x, y, z = (float(component) for component in direction)
    except (TypeError, ValueError):
        raise PhysicsError(
            f'gravity_direction is {direction!r}: three numbers x, y, z are needed.'
        ) from None
    length = math.sqrt(x * x + y * y + z * z)
    if not (math.isfinite(length) and length > 1e-6):
        raise PhysicsError(
            f'gravity_direction is {[x, y, z]}: a finite vector that is not zero is needed.'
        )
    # A vector that is a unit vector to rounding keeps its bits, so that a recorded direction
    # read back is the very direction that was used.
    if abs(length - 1.0) < 1e-15:
        return (x, y, z)
    return (x / length, y / length, z / length)
