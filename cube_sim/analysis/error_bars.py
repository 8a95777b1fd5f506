"""How far estimates from poses are off, as measured by `benchmarks/estimation.py`."""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class ErrorBars:
    """Nine of ten estimates are off by no more than this; `rate_hz` is where it was measured."""

    rate_hz: int
    time_s: float
    place_m: float
    speed_m_s: float
    spin_rad_s: float
    restitution: float
    friction: float
    tangential_factor: float


# Time, place and speed are off by what happens within a time step of the simulation (2 ms): a cube
# sinks in before it is pushed out. Restitution suffers the more the slower a bounce is, and at 200
# poses a second slower bounces are found.
_MEASURED = (
    ErrorBars(50, 0.0035, 0.012, 0.2, 1e-6, 0.07, 0.01, 1e-6),
    ErrorBars(200, 0.0045, 0.015, 0.2, 1e-6, 0.08, 0.01, 1e-6),
)

# Between two bounces there must be this many poses for a flight to be seen.
POSES_OF_A_FLIGHT = 3


def error_bars(period_ns: int) -> ErrorBars:
    """Return those measured at the rate nearest to one pose every `period_ns`."""
    rate = 1e9 / max(period_ns, 1)
    return min(_MEASURED, key=lambda bars: abs(math.log(rate / bars.rate_hz)))
