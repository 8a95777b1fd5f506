"""How cubes are thrown, each quantity declared once as the settings of the physics are."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from cube_sim.physics.settings import (
    Quantity,
    checked_number,
    checked_vector,
    checked_whole,
    quantity,
)

Vector = tuple[float, float, float]

# By the type of a field's default.
CHECKS: dict[type, Callable[[str, Any, Quantity], Any]] = {
    tuple: checked_vector,
    float: checked_number,
    int: checked_whole,
}


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
            check = CHECKS[type(field.default)]
            object.__setattr__(self, field.name, check(field.name, value, declared))
