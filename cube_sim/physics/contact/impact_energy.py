"""The energy of the groups of cubes that impacts join: an impact never adds to it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.forest import root
from cube_sim.physics.contact.layout import (
    BEFORE,
    BODY_A,
    COUNT,
    CUBE,
    CUBE_A,
    CUBE_B,
    ENERGY,
    FRICTION,
    HIT_ROOT,
    JN,
    JT,
    LANES,
    LENGTH,
    MEMBER,
    POINT,
    POINT_SIZE,
    V,
)
from cube_sim.physics.contact.rules import Rules

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

# A group that gains a smaller share of its energy is not solved again.
SLIGHT = 1e-2


@compiled
def note_energy(
    cubes: Floats,
    marks: Integers,
    ends: Integers,
    bodies: Floats,
    rules: Rules,
    members: int,
    one: int,
    other: int,
    column: int,
) -> None:
    """
    Write half the scalar product of two velocities of each group, by mass and inertia, J.

    `one` and `other` are where they begin in its bodies; with both the same it is the energy.
    """
    for n in range(members):
        cubes[int(bodies[ends[n, MEMBER], CUBE]), column] = 0.0
    for n in range(members):
        body = bodies[ends[n, MEMBER]]
        total = 0.0
        for k in range(3):
            total += body[one + k] * body[other + k]
            total += body[one + 3 + k] * body[other + 3 + k] / rules.inverse_inertia
        cubes[root(marks, HIT_ROOT, int(body[CUBE])), column] += 0.5 * total


@compiled
def take_back(
    cubes: Floats,
    marks: Integers,
    ends: Integers,
    bodies: Floats,
    blocks: Floats,
    lanes: Integers,
    first: int,
    last: int,
    members: int,
    share: float,
) -> bool:
    """
    Undo the groups that gained more than SLIGHT by the energies noted, with a `share` of friction.

    Return whether there was any; what is left of friction counts when they are solved again.
    """
    undone = False
    for n in range(members):
        slot = ends[n, MEMBER]
        group = root(marks, HIT_ROOT, int(bodies[slot, CUBE]))
        if cubes[group, ENERGY + 1] > cubes[group, ENERGY] * (1.0 + SLIGHT):
            undone = True
            for k in range(6):
                bodies[slot, V + k] = bodies[slot, BEFORE + k]
    if not undone:
        return False
    for k in range(first, last):
        block, lane = blocks[k], lanes[k]
        for i in range(lane[LENGTH]):
            group = group_of_pair(marks, lane, i)
            if cubes[group, ENERGY + 1] > cubes[group, ENERGY] * (1.0 + SLIGHT):
                block[FRICTION + i] *= share
                scale_impulses(block, lane[COUNT], i, 0.0)
    return True


@compiled
def hold_energy(
    cubes: Floats,
    marks: Integers,
    ends: Integers,
    bodies: Floats,
    blocks: Floats,
    lanes: Integers,
    rules: Rules,
    first: int,
    last: int,
    members: int,
) -> None:
    """
    Scale the impulses of each group that has gained energy just so far that it stays.

    With v + s dv the energy is a parabola in s, which begins at the energy of before; it comes back
    to that at s = -(v.dv) / (dE - v.dv). Cones and momentum know no scale.
    """
    note_energy(cubes, marks, ends, bodies, rules, members, BEFORE, V, ENERGY + 2)
    for n in range(members):
        body = bodies[ends[n, MEMBER]]
        scale = scale_of(cubes, root(marks, HIT_ROOT, int(body[CUBE])))
        if scale < 1.0:
            for k in range(6):
                body[V + k] = body[BEFORE + k] + scale * (body[V + k] - body[BEFORE + k])
    for k in range(first, last):
        block, lane = blocks[k], lanes[k]
        for i in range(lane[LENGTH]):
            scale = scale_of(cubes, group_of_pair(marks, lane, i))
            if scale < 1.0:
                scale_impulses(block, lane[COUNT], i, scale)


@compiled
def scale_of(cubes: Floats, group: int) -> float:
    """Return by what the impulses of a group are to be scaled; 1 where no energy was gained."""
    gain = cubes[group, ENERGY + 1] - cubes[group, ENERGY]
    along = 2.0 * (cubes[group, ENERGY + 2] - cubes[group, ENERGY])
    if gain <= 0.0:
        return 1.0
    scale: float = max(-(along / (gain - along)), 0.0)
    return scale


@compiled
def group_of_pair(marks: Integers, lane: Integers, i: int) -> int:
    """Return the group of pair i of a block: that of the one of its cubes that moves."""
    cube = lane[CUBE_A + i] if lane[BODY_A + i] > 0 else lane[CUBE_B + i]
    return root(marks, HIT_ROOT, cube)


@compiled
def scale_impulses(block: Floats, count: int, i: int, scale: float) -> None:
    """Scale the impulses of pair i of a block."""
    for p in range(count):
        start = POINT + p * POINT_SIZE
        for c in range(start + JN, start + JT + 3 * LANES, LANES):
            block[c + i] *= scale
