"""
The physics models by name: the one registry.

Parameters, error messages and documents take the names from here. A model is a file of this
folder with a `CODE` and a function `respond`; one line here and one in `step.respond` add it.
"""

from __future__ import annotations

from dataclasses import dataclass

from cube_sim.physics.models import impulse, simple
from cube_sim.physics.refusal import PhysicsError


@dataclass(frozen=True)
class Model:
    """A response to contact: its number in compiled code, and what it does in a sentence."""

    code: int
    summary: str


MODELS: dict[str, Model] = {
    'simple': Model(simple.CODE, 'reflects the velocity of the centre and leaves the spin alone'),
    'impulse': Model(impulse.CODE, 'one normal and one friction impulse at the contact point'),
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
