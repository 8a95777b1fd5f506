"""The step of all cubes that touch each other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.layout import (
    ACTIVE,
    ACTIVES,
    ASLEEP,
    FORCE,
    GROUPED,
    IMPULSE_N,
    LOCAL_A,
    POINT,
    POINT_COLUMNS,
    POINTS,
    PUSH,
    SHIFT,
    SOLVED,
    SV,
    SW,
    TOTAL,
    TOUCHED,
    TURN,
)
from cube_sim.physics.contact.rules import Rules
from cube_sim.physics.contact.solver import (
    PUSHING,
    RELAXING,
    WARM,
    add_up,
    impacts,
    note_touched,
    sweep,
)
from cube_sim.physics.rotation import composed, rotor

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


# The sweeps of a solution: as many as VISITS of pairs allow, within bounds, or until no impulse
# changes by more than a share of the weight.
FEWEST_SWEEPS, MOST_SWEEPS, VISITS = 1, 16, 1600
ENOUGH = 1e-5


@compiled
def step_in_common(
    state: Floats,
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    ends: Integers,
    counters: Integers,
    rules: Rules,
    count: int,
    substeps: int,
    ground: int,
) -> None:
    """
    Advance the grouped cubes by a step of `substeps` parts.

    A part: impacts; gravity; the impulses of the last part; velocities that keep cubes apart and
    push them apart where they overlap; places; velocities again without the pushing.
    """
    time = rules.time_step / substeps
    active = counters[ACTIVES]
    # Small groups are solved out, large ones as far as the time allows: sweeps are rationed.
    most = max(FEWEST_SWEEPS, min(MOST_SWEEPS, VISITS // max(active, 1)))
    enough = ENOUGH * rules.gravity * time
    for _ in range(substeps):
        counters[SOLVED] += impacts(cubes, marks, pairs, ends, active, rules, count, time)
        for i in range(count):
            if marks[i, GROUPED] and not marks[i, ASLEEP]:
                cubes[i, SV] += rules.gx * time
                cubes[i, SV + 1] += rules.gy * time
                cubes[i, SV + 2] += rules.gz * time
        sweep(cubes, pairs, ends, active, rules, time, WARM, False)
        for n in range(most):
            change = sweep(cubes, pairs, ends, active, rules, time, PUSHING, n % 2 == 1)
            counters[SOLVED] += 1
            if change <= enough:
                break
        note_touched(marks, pairs, ends, active)
        for i in range(count):
            if marks[i, GROUPED] and not marks[i, ASLEEP]:
                for n in range(3):
                    cubes[i, SHIFT + n] += cubes[i, SV + n] * time
                    cubes[i, TURN + n] += cubes[i, SW + n] * time
        for n in range(most):
            change = sweep(cubes, pairs, ends, active, rules, time, RELAXING, n % 2 == 0)
            counters[SOLVED] += 1
            if change <= enough:
                break
        note_touched(marks, pairs, ends, active)
        add_up(pairs, ends, active)
    whole = rules.time_step
    for i in range(count):
        if marks[i, GROUPED] and not marks[i, ASLEEP]:
            # What nothing has touched flies its parabola.
            if not marks[i, TOUCHED]:
                cubes[i, SHIFT] = whole * (cubes[i, SV] - 0.5 * whole * rules.gx)
                cubes[i, SHIFT + 1] = whole * (cubes[i, SV + 1] - 0.5 * whole * rules.gy)
                cubes[i, SHIFT + 2] = whole * (cubes[i, SV + 2] - 0.5 * whole * rules.gz)
            for n in range(3):
                state[n, i] += cubes[i, SHIFT + n]
                state[7 + n, i] = cubes[i, SV + n]
                state[10 + n, i] = cubes[i, SW + n]
            x, y, z, w = rotor(cubes[i, TURN], cubes[i, TURN + 1], cubes[i, TURN + 2], 1.0)
            x, y, z, w = composed(x, y, z, w, state[3, i], state[4, i], state[5, i], state[6, i])
            scale = 1.0 / math.sqrt((x * x + y * y) + (z * z + w * w))
            state[3, i] = x * scale
            state[4, i] = y * scale
            state[5, i] = z * scale
            state[6, i] = w * scale
    for n in range(active):
        if ends[n, ACTIVE + 1] == ground:
            number, i = ends[n, ACTIVE], ends[n, ACTIVE + 2]
            for p in range(ends[number, POINTS]):
                at = POINT + p * POINT_COLUMNS
                k = int(pairs[number, at + LOCAL_A])
                cubes[i, FORCE + 3 * k] = pairs[number, at + IMPULSE_N + 1] / time
                cubes[i, FORCE + 3 * k + 1] = pairs[number, at + IMPULSE_N + 2] / time
                cubes[i, FORCE + 3 * k + 2] = pairs[number, at + IMPULSE_N] / time
                for m in range(3):
                    cubes[i, PUSH + 3 * k + m] = pairs[number, at + TOTAL + m]
