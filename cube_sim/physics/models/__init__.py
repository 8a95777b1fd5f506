"""
The physics models by name: the one registry.

Parameters, error messages and documents take the names from here. A model has a `CODE` and an
engine, which advances the cubes by it (see `cube_sim.physics.engine`). One whose cubes do not
touch each other is a file of this folder with a function `respond`: one line here and one in
`step.respond` add it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

from cube_sim.physics.models import contact, impulse, simple
from cube_sim.physics.refusal import PhysicsError

if TYPE_CHECKING:
    from cube_sim.physics.engine import Engine


@dataclass(frozen=True)
class Model:
    """A physics model: its number, its engine for so many threads, and a sentence on it."""

    code: int
    engine: Callable[[int], Engine]
    summary: str


# Engines are imported when they are made: each brings its machine code along.
def _independent(code: int) -> Callable[[int], Engine]:
    def engine(threads: int) -> Engine:
        from cube_sim.physics.independent import IndependentCubes

        return IndependentCubes(code, threads)

    return engine


def _touching(threads: int) -> Engine:
    from cube_sim.physics.contact.engine import TouchingCubes

    return TouchingCubes()


MODELS: dict[str, Model] = {
    'simple': Model(
        simple.CODE,
        _independent(simple.CODE),
        'reflects the velocity of the centre and leaves the spin alone',
    ),
    'impulse': Model(
        impulse.CODE,
        _independent(impulse.CODE),
        'one normal and one friction impulse at the contact point',
    ),
    'contact': Model(
        contact.CODE,
        _touching,
        'rigid bodies that bounce, slide, collide with each other, stack and come to rest',
    ),
}


def model_named(name: str) -> Model:
    """Return the model called `name`; PhysicsError lists the names there are."""
    model = MODELS.get(name) if isinstance(name, str) else None
    if model is None:
        raise PhysicsError(f'No physics model is called {name!r}; there are: {", ".join(MODELS)}.')
    return model


def next_model(name: str) -> str:
    """Return the name after `name` in the registry, the first after the last."""
    names = list(MODELS)
    return names[(names.index(name) + 1) % len(names)]
