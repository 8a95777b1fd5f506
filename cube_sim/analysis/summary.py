"""Findings in few numbers: spreads over bounces, and where the energy went."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from cube_sim.analysis.findings import Findings
from cube_sim.physics import Settings

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Spread:
    """How `count` values are distributed: median, 5th and 95th percentile, least and most."""

    count: int
    median: float
    low: float
    high: float
    least: float
    most: float

    @classmethod
    def of(cls, values: Floats) -> Spread | None:
        """Return that of the finite ones of `values`, or None if there are none."""
        values = values[np.isfinite(values)]
        if not len(values):
            return None
        low, median, high = np.percentile(values, (5.0, 50.0, 95.0))
        return cls(
            len(values),
            float(median),
            float(low),
            float(high),
            float(values.min()),
            float(values.max()),
        )


@dataclass(frozen=True)
class Regime:
    """
    What the bounces under the same settings say of them.

    `friction` leaves out the `bounds`: bounces that only say how much friction there is at least.
    """

    settings: Settings
    bounces: int
    restitution: Spread | None
    friction: Spread | None
    bounds: int
    tangential_factor: Spread | None


@dataclass(frozen=True)
class Budget:
    """
    The energy of all cubes, J: what was thrown in, what came and went since, and what is left.

    thrown + flight + lift + bounced + touched + changed + unclear = removed + left: by throws; by
    the integrator in flight; by being pushed out of the plane; at bounces and at slower touches;
    by changes of gravity or size; where poses cannot tell; carried off by resets; still there.
    nan where it is not known.
    """

    thrown: float
    flight: float
    lift: float
    bounced: float
    touched: float
    changed: float
    unclear: float
    removed: float
    left: float

    @property
    def residue(self) -> float:
        """What is missing for the sum to close, J: rounding, when everything is known."""
        gained = self.flight + self.lift + self.bounced + self.touched + self.changed
        return self.thrown + gained + self.unclear - self.removed - self.left


def regimes(found: Findings) -> list[Regime]:
    """Return what was measured, apart for each set of coefficients that a bounce met."""
    measures = found.measures()
    used = found.bounces.records['settings']
    groups: dict[tuple[str, float, float, float], list[int]] = {}
    for index, record in enumerate(found.settings):
        key = (record.model, record.restitution, record.friction, record.tangential_factor)
        groups.setdefault(key if found.set_known else ('', 0.0, 0.0, 0.0), []).append(index)
    rows = []
    for indices in groups.values():
        mine = np.isin(used, indices)
        if not mine.any():
            continue
        model = found.settings[indices[0]].model if found.set_known else ''
        bounds = measures.friction_is_bound & mine
        kept = measures.tangential_factor[mine]
        rows.append(
            Regime(
                found.settings[indices[0]],
                int(mine.sum()),
                Spread.of(measures.restitution[mine]),
                Spread.of(measures.friction[mine & ~bounds]),
                int(bounds.sum()),
                Spread.of(kept) if model in ('simple', '') else None,
            )
        )
    return rows


def budget(found: Findings) -> Budget:
    """Return where the energy of all cubes went."""
    cubes = found.cubes.records
    ended = cubes['end_energy'].sum(axis=1)
    return Budget(
        thrown=float(cubes['thrown_energy'].sum()),
        **{
            name: float(cubes[name].sum())
            for name in ('flight', 'lift', 'bounced', 'touched', 'changed', 'unclear')
        },
        removed=float(ended[cubes['removed']].sum()),
        left=float(ended[~cubes['removed']].sum()),
    )
