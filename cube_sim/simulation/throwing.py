"""How cubes are thrown, each quantity declared once as the settings of the physics are."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

from cube_sim.physics.refusal import PhysicsError
from cube_sim.physics.settings import Quantity, checked_number, checked_vector, quantity

Vector = tuple[float, float, float]


@dataclass(frozen=True)
class Throwing:
    """
    What a throw takes when it is not told otherwise, and how many there may be.

    Checked when it is made: PhysicsError says which value is wrong and what would be right.
    """

    throw_speed: float = quantity(
        8.0, 'm/s', -1000.0, 1000.0, 'Speed of a thrown cube along the x axis of the camera'
    )
    throw_spin: Vector = quantity(
        (1.0, 2.0, 3.0), 'rad/s', -1000.0, 1000.0, 'Spin of a thrown cube in the axes of the camera'
    )
    max_cubes: int = quantity(
        1000, '', 1, 1_000_000, 'Throws beyond this many cubes are refused until a reset'
    )

    def __post_init__(self) -> None:
        """Check every value."""
        for field in dataclasses.fields(self):
            declared: Quantity = field.metadata['quantity']
            value: Any = getattr(self, field.name)
            check = checked_vector if isinstance(field.default, tuple) else checked_number
            object.__setattr__(self, field.name, check(field.name, value, declared))
        if self.max_cubes != int(self.max_cubes):
            raise PhysicsError(f'max_cubes is {self.max_cubes}: a whole number is needed.')
        object.__setattr__(self, 'max_cubes', int(self.max_cubes))
