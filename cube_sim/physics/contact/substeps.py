"""The step of all cubes that touch each other."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from cube_sim.physics.compiled import compiled
from cube_sim.physics.contact.blocks import (
    colour_pairs,
    fill_blocks,
    lay_out,
    note_touched,
    read_back,
    take_up_bodies,
)
from cube_sim.physics.contact.impacts import FEW_PAIRS, solve_impacts
from cube_sim.physics.contact.layout import (
    ACTIVES,
    BLOCKS,
    BODIES,
    CUBE,
    FASTEST,
    IMPACTS,
    PUSHED,
    SHIFT,
    SWEEPS,
    TOUCHED,
    TURN,
    V,
    W,
)
from cube_sim.physics.contact.neighbours import DIAGONAL
from cube_sim.physics.contact.overlap import keep_angular_momentum, push_apart
from cube_sim.physics.contact.rules import Rules
from cube_sim.physics.contact.solver import (
    SLOP,
    find_hits,
    move_along,
    start_from_last,
    sweep,
)
from cube_sim.physics.rotation import composed, rotor

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


# A small group of pairs gets more sweeps: up to MORE_SWEEPS times as many, as long as all visits of
# its pairs stay below what FULL_SWEEPS pairs get by the least number.
MORE_SWEEPS, FULL_SWEEPS = 12, 1500
# Nor are there more once no impulse changes by more than a share of the weight.
ENOUGH = 1e-5
# So many impacts follow each other in a sub-step at most; the last ones are then stopped dead.
MOST_IMPACTS, IMPACTS_OF_A_CROWD = 16, 2
# So many sweeps for each that takes overlap away.
SWEEPS_OF_A_PUSH = 4


@compiled
def step_in_common(
    state: Floats,
    cubes: Floats,
    marks: Integers,
    pairs: Floats,
    ends: Integers,
    bodies: Floats,
    blocks: Floats,
    lanes: Integers,
    work: Floats,
    counters: Integers,
    rules: Rules,
    count: int,
    substeps: int,
    ground: int,
    last_time: float,
) -> None:
    """
    Advance the grouped cubes by a step of `substeps` parts.

    A part: impacts; gravity; the impulses of the last part; velocities that keep cubes apart;
    others that take overlap away; places by both. `last_time` is the length of a part of the
    last step, s.
    """
    time = rules.time_step / substeps
    take_up_bodies(state, marks, bodies, counters, count)
    colour_pairs(marks, ends, counters)
    lay_out(ends, lanes, counters)
    scale = time / last_time
    fill_blocks(cubes, marks, pairs, ends, bodies, blocks, lanes, counters, rules, ground, scale)
    count = counters[BLOCKS]

    # Small groups are solved out, large ones as far as the time allows: sweeps are rationed.
    least = int(rules.sweeps)
    most = max(least, min(MORE_SWEEPS * least, FULL_SWEEPS * least // max(counters[ACTIVES], 1)))
    enough = ENOUGH * rules.gravity * time
    slop = SLOP * 2.0 * rules.half_side
    # Nor does a point hit with a speed that gravity gives in two steps.
    threshold = rules.threshold + 2.0 * rules.gravity * rules.time_step
    move_along(blocks, lanes, bodies, work, count, time, slop, 0.0)
    series = IMPACTS_OF_A_CROWD if counters[ACTIVES] > FEW_PAIRS else MOST_IMPACTS
    note_fastest(bodies, counters, rules)
    for _ in range(substeps):
        # One impact after another: who is hit may hit the next.
        for _ in range(series):
            hits = find_hits(
                blocks, lanes, bodies, work, count, time, slop, threshold, rules.restitution
            )
            if hits == 0:
                break
            counters[IMPACTS] += hits
            counters[SWEEPS] += solve_impacts(
                cubes, marks, ends, bodies, blocks, lanes, work, counters, rules, slop
            )
            note_fastest(bodies, counters, rules)
        fall(bodies, counters, rules, time)
        start_from_last(blocks, lanes, bodies, work, count)
        counters[SWEEPS] += solve(blocks, lanes, bodies, work, count, most, enough)
        pushes = max(most // SWEEPS_OF_A_PUSH, 1)
        pushed = push_apart(blocks, lanes, bodies, work, counters, time, slop, pushes)
        advance_bodies(bodies, counters, time)
        move_along(blocks, lanes, bodies, work, count, time, slop, 1.0)
        if pushed > 0:
            keep_angular_momentum(blocks, lanes, bodies, work, counters, time)
    note_touched(blocks, lanes, bodies, 0, count)
    put_down(state, bodies, counters, rules)
    read_back(cubes, pairs, ends, blocks, lanes, counters, rules, ground, scale, time)


@compiled
def solve(
    blocks: Floats,
    lanes: Integers,
    bodies: Floats,
    work: Floats,
    count: int,
    most: int,
    enough: float,
) -> int:
    """Sweep to and fro until no impulse changes by more than `enough`; return how often."""
    for n in range(most):
        if sweep(blocks, lanes, bodies, work, 0, count, n % 2 == 1, enough) == 0:
            return n + 1
    return most


@compiled
def note_fastest(bodies: Floats, counters: Integers, rules: Rules) -> None:
    """Write a bound of how fast any point of each body is in this step if nothing hits it."""
    reach = rules.half_side * DIAGONAL
    for n in range(1, counters[BODIES]):
        body = bodies[n]
        speed = (abs(body[V]) + abs(body[V + 1])) + abs(body[V + 2])
        spin = (abs(body[W]) + abs(body[W + 1])) + abs(body[W + 2])
        body[FASTEST] = speed + spin * reach + 0.5 * rules.gravity * rules.time_step


@compiled
def fall(bodies: Floats, counters: Integers, rules: Rules, time: float) -> None:
    """Let gravity act for a time, s."""
    for n in range(1, counters[BODIES]):
        bodies[n, V] += rules.gx * time
        bodies[n, V + 1] += rules.gy * time
        bodies[n, V + 2] += rules.gz * time


@compiled
def advance_bodies(bodies: Floats, counters: Integers, time: float) -> None:
    """Let the bodies go with their velocities and those of a push for a time, s."""
    for n in range(1, counters[BODIES]):
        for k in range(3):
            bodies[n, SHIFT + k] += (bodies[n, V + k] + bodies[n, PUSHED + k]) * time
            bodies[n, TURN + k] += (bodies[n, W + k] + bodies[n, PUSHED + 3 + k]) * time


@compiled
def put_down(state: Floats, bodies: Floats, counters: Integers, rules: Rules) -> None:
    """Write the bodies back to the state of their cubes."""
    whole = rules.time_step
    for n in range(1, counters[BODIES]):
        body = bodies[n]
        i = int(body[CUBE])
        # What nothing has touched flies its parabola.
        if body[TOUCHED] == 0.0:
            body[SHIFT] = whole * (body[V] - 0.5 * whole * rules.gx)
            body[SHIFT + 1] = whole * (body[V + 1] - 0.5 * whole * rules.gy)
            body[SHIFT + 2] = whole * (body[V + 2] - 0.5 * whole * rules.gz)
        for k in range(3):
            state[k, i] += body[SHIFT + k]
            state[7 + k, i] = body[V + k]
            state[10 + k, i] = body[W + k]
        x, y, z, w = rotor(body[TURN], body[TURN + 1], body[TURN + 2], 1.0)
        x, y, z, w = composed(x, y, z, w, state[3, i], state[4, i], state[5, i], state[6, i])
        scale = 1.0 / math.sqrt((x * x + y * y) + (z * z + w * w))
        state[3, i] = x * scale
        state[4, i] = y * scale
        state[5, i] = z * scale
        state[6, i] = w * scale
