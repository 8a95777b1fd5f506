"""The names under which a run is set up from outside, and the records that hold their values."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from cube_sim.physics.refusal import PhysicsError
from cube_sim.physics.settings import Settings
from cube_sim.simulation.throwing import Throwing

# ROS parameter -> field of Settings, where the two differ in name or unit.
_RENAMED = {'physics_model': 'model', 'time_step': 'time_step_ns'}

PHYSICS: dict[str, str] = {
    **_RENAMED,
    **{
        field.name: field.name
        for field in dataclasses.fields(Settings)
        if field.name not in _RENAMED.values()
    },
}
THROWING = tuple(field.name for field in dataclasses.fields(Throwing))

# What may change while the simulation runs, by `ros2 param set` and by a scenario.
CHANGEABLE = tuple(name for name in (*PHYSICS, *THROWING) if name != 'time_step')


def nanoseconds(seconds: float, name: str = 'time_step') -> int:
    """Return a time in whole nanoseconds; PhysicsError when it is none, beyond float rounding."""
    scaled = seconds * 1e9
    if not (abs(scaled) < 2**62 and abs(scaled - round(scaled)) <= max(1e-6, 4e-16 * abs(scaled))):
        raise PhysicsError(f'{name} is {seconds!r} s: a whole number of nanoseconds is needed.')
    return round(scaled)


def settings_with(settings: Settings, changes: Mapping[str, Any]) -> Settings:
    """Return `settings` with those of the parameters `changes` that are physics; PhysicsError."""
    fields = {PHYSICS[name]: value for name, value in changes.items() if name in PHYSICS}
    if 'time_step_ns' in fields:
        fields['time_step_ns'] = nanoseconds(fields['time_step_ns'])
    return settings.changed(**fields) if fields else settings


def throwing_with(throwing: Throwing, changes: Mapping[str, Any]) -> Throwing:
    """Return `throwing` with those of the parameters `changes` that are its own; PhysicsError."""
    fields = {name: value for name, value in changes.items() if name in THROWING}
    return dataclasses.replace(throwing, **fields) if fields else throwing


def physics_parameters(settings: Settings) -> dict[str, Any]:
    """Return the settings by parameter name, the time step in seconds."""
    values = {name: getattr(settings, field) for name, field in PHYSICS.items()}
    values['time_step'] = settings.time_step
    return values
