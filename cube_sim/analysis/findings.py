"""What was found out about a run, in one form for both ways of finding out."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.bounces import BOUNCE, Measures, measure
from cube_sim.analysis.cubes import CUBE, Records, Table
from cube_sim.analysis.trace import Trace
from cube_sim.physics import Settings

Floats = NDArray[np.float64]

# How the motion is known: simulated again step by step, or from the recorded poses alone.
REPLAY, POSES = 'replay', 'poses'

# Where poses alone cannot tell: more than one contact between two of them, or none with the plane.
STRETCH = np.dtype(
    [
        ('generation', np.int32),
        ('cube', np.int32),
        ('start_ns', np.int64),
        ('end_ns', np.int64),
    ]
)


@dataclass
class Findings:
    """
    The cubes, the bounces and the course of a run.

    `settings` are all that held, with the time from which they did, ns; `set_known` tells
    whether they come from the bag. `unclear` (STRETCH) is where poses alone cannot tell.
    """

    method: str
    cubes: Table = field(default_factory=lambda: Table(CUBE))
    bounces: Table = field(default_factory=lambda: Table(BOUNCE))
    unclear: Table = field(default_factory=lambda: Table(STRETCH))
    settings: list[Settings] = field(default_factory=list)
    settings_from_ns: list[int] = field(default_factory=list)
    set_known: bool = True
    resets_ns: list[int] = field(default_factory=list)
    trace: Trace = field(default_factory=Trace)
    messages: int = 0
    start_ns: int = 0
    end_ns: int = 0
    period_ns: int = 0
    notes: list[str] = field(default_factory=list)

    def measures(self) -> Measures:
        """Return what the bounces say about restitution and friction."""
        models = [record.model if self.set_known else '' for record in self.settings]
        return measure(self.bounces.records, self.settings, models)

    def bounces_of(self, cube: Records) -> NDArray[np.intp]:
        """Return the indices of the bounces of one record of `cubes`."""
        bounces = self.bounces.records
        mine = (bounces['generation'] == cube['generation']) & (bounces['cube'] == cube['cube'])
        return np.flatnonzero(mine)
