"""
What a step costs, beside the same motion in vectorised numpy and cube after cube in numba.

Run: python3 benchmarks/steps.py. Independent cubes in flight, then 3 s of throws at 8 m/s with
contacts (model impulse, steps of 2 ms). The three take turns in one run, the best of several
rounds is shown: these figures are to be read as ratios.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from numba import njit

from cube_sim.physics import Settings, World

COUNTS = (1, 10, 100, 1000, 10_000)
ROUNDS = 7
DT = 0.002


def states(count: int, height: float) -> tuple[np.ndarray, ...]:
    """Return positions, orientations, velocities and spins of cubes in flight."""
    rng = np.random.default_rng(count)
    orientations = rng.normal(size=(count, 4))
    orientations /= np.linalg.norm(orientations, axis=1, keepdims=True)
    directions = rng.normal(size=(count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    positions = np.tile([0.0, 0.0, height], (count, 1))
    return positions, orientations, 8.0 * directions, np.tile([1.0, 2.0, 3.0], (count, 1))


def cube_sim_stepper(count: int, steps: int) -> Callable[[], None]:
    """Return a function that advances a world of cubes by `steps`."""
    world = World(Settings(model='impulse'))
    world.throw(*states(count, 5e6))
    return lambda: world.step(steps)


def numpy_stepper(count: int, steps: int) -> Callable[[], None]:
    """Return the same motion and detection in vectorised numpy."""
    p, q, v, w = (array.copy() for array in states(count, 5e6))

    def advance() -> None:
        for _ in range(steps):
            v[:, 2] -= 9.81 * DT
            p[:] += v * DT
            half = 0.5 * DT * np.sqrt(np.sum(w * w, axis=1))
            s = np.sin(half) / np.maximum(half, 1e-12) * (0.5 * DT)
            bx, by, bz, bw = w[:, 0] * s, w[:, 1] * s, w[:, 2] * s, np.cos(half)
            x, y, z, u = q.T
            turned = np.stack(
                [
                    bw * x + bx * u + by * z - bz * y,
                    bw * y - bx * z + by * u + bz * x,
                    bw * z + bx * y - by * x + bz * u,
                    bw * u - bx * x - by * y - bz * z,
                ],
                axis=1,
            )
            q[:] = turned / np.sqrt(np.sum(turned * turned, axis=1, keepdims=True))
            x, y, z, u = q.T
            reach = np.abs(x * z - y * u) + np.abs(y * z + x * u)
            reach += np.abs(0.5 - x * x - y * y)
            assert (p[:, 2] - 0.5 * reach > 0.0).all()

    return advance


@njit
def _one_after_another(p, q, v, w, steps):  # type: ignore[no-untyped-def]
    for _ in range(steps):
        for i in range(p.shape[0]):
            v[i, 2] -= 9.81 * DT
            for k in range(3):
                p[i, k] += v[i, k] * DT
            half = 0.5 * DT * np.sqrt(w[i, 0] ** 2 + w[i, 1] ** 2 + w[i, 2] ** 2)
            s = np.sin(half) / max(half, 1e-12) * (0.5 * DT)
            bx, by, bz, bw = w[i, 0] * s, w[i, 1] * s, w[i, 2] * s, np.cos(half)
            x, y, z, u = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
            nx = bw * x + bx * u + by * z - bz * y
            ny = bw * y - bx * z + by * u + bz * x
            nz = bw * z + bx * y - by * x + bz * u
            nu = bw * u - bx * x - by * y - bz * z
            scale = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz + nu * nu)
            q[i, 0], q[i, 1], q[i, 2], q[i, 3] = nx * scale, ny * scale, nz * scale, nu * scale
            lowest = 1e9
            for a in (-0.25, 0.25):
                for b in (-0.25, 0.25):
                    for c in (-0.25, 0.25):
                        x, y, z, u = q[i, 0], q[i, 1], q[i, 2], q[i, 3]
                        up = a * 2 * (x * z - y * u) + b * 2 * (y * z + x * u)
                        up += c * (1 - 2 * (x * x + y * y))
                        lowest = min(lowest, p[i, 2] + up)
            if lowest < 0.0:
                p[i, 2] -= lowest


def numba_stepper(count: int, steps: int) -> Callable[[], None]:
    """Return the same cube after cube, each with its eight corners, compiled by numba."""
    p, q, v, w = (array.copy() for array in states(count, 5e6))
    return lambda: _one_after_another(p, q, v, w, steps)


STEPPERS = {
    'cube_sim': cube_sim_stepper,
    'numba, one by one': numba_stepper,
    'numpy': numpy_stepper,
}


def microseconds(count: int, steps: int) -> dict[str, float]:
    """Return the best time of a step of each, us; they take turns."""
    calls = max(3, int(20_000 / (count * steps)))
    run = {name: make(count, steps) for name, make in STEPPERS.items()}
    best = dict.fromkeys(run, float('inf'))
    for round_ in range(ROUNDS + 1):
        for name, advance in run.items():
            start = time.perf_counter()
            for _ in range(calls):
                advance()
            taken = (time.perf_counter() - start) / (calls * steps) * 1e6
            if round_:  # the first compiles
                best[name] = min(best[name], taken)
    return best


def main() -> None:
    """Measure and print the tables."""
    for steps in (1, 10):
        print(f'\nIn flight, {steps} step(s) per call, us per step:\n')
        print('| cubes | ' + ' | '.join(STEPPERS) + ' | numpy / cube_sim | numba / cube_sim |')
        print('|---|' + '---|' * (len(STEPPERS) + 2))
        for count in COUNTS:
            best = microseconds(count, steps)
            ours = best['cube_sim']
            print(
                f'| {count} | '
                + ' | '.join(f'{best[name]:.2f}' for name in STEPPERS)
                + f' | {best["numpy"] / ours:.1f} | {best["numba, one by one"] / ours:.1f} |'
            )
    print('\nThrown from 1.5 m, 3 s with contacts, 10 steps per call:\n')
    print('| cubes | us per step | contacts per step |')
    print('|---|---|---|')
    for count in COUNTS:
        world = World(Settings(model='impulse'))
        world.throw(*states(count, 1.5))
        start = time.perf_counter()
        for _ in range(150):
            world.step(10)
        taken = (time.perf_counter() - start) / 1500 * 1e6
        print(f'| {count} | {taken:.2f} | {world.contacts / 1500:.1f} |')


if __name__ == '__main__':
    main()
