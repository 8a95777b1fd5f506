"""Model `simple`: the report's "réponse simple"."""

from __future__ import annotations

from cube_sim.physics.compiled import compiled
from cube_sim.physics.constants import Constants, Velocities

CODE = 0


@compiled
def respond(
    constants: Constants,
    rx: float,
    ry: float,
    rz: float,
    vx: float,
    vy: float,
    vz: float,
    wx: float,
    wy: float,
    wz: float,
) -> Velocities:
    """
    Return the velocities after a contact at r = (rx, ry, rz) from the centre.

    v becomes (f vx, f vy, -e vz) when the cube sinks; the spin stays. A cube that rises
    already is left alone, or the reflection would throw it down.
    """
    if vz < 0.0:
        vx = constants.tangential_factor * vx
        vy = constants.tangential_factor * vy
        vz = -(constants.restitution * vz)
    return vx, vy, vz, wx, wy, wz
