"""
What a step of the model contact costs, beside MuJoCo in the same run where it is installed.

Run: python3 benchmarks/contact_speed.py [SECONDS]; ten simulated seconds (the default) of a pile
take MuJoCo seven minutes. Cubes of 0.5 m, e = mu = 0.5, 240 steps a second, one thread: thrown at
8 m/s as if alone (collide_cubes off), and 1000 dropped in a pile. Figures are processor time, so
that a busy machine shows less in them.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable

import numpy as np

from cube_sim.physics import Settings, World

RATE, COUNT = 240, 1000
SECONDS = 10

Scene = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


def settings(collide: bool) -> Settings:
    """Return the settings of both scenes."""
    return Settings(model='contact', time_step_ns=round(1e9 / RATE), collide_cubes=collide)


def thrown() -> Scene:
    """Return cubes thrown at 8 m/s in random directions from 1.5 m."""
    rng = np.random.default_rng(1)
    turns = rng.normal(size=(COUNT, 4))
    ways = rng.normal(size=(COUNT, 3))
    return (
        np.tile([0.0, 0.0, 1.5], (COUNT, 1)),
        turns / np.linalg.norm(turns, axis=1, keepdims=True),
        8.0 * ways / np.linalg.norm(ways, axis=1, keepdims=True),
        np.tile([1.0, 2.0, 3.0], (COUNT, 1)),
    )


def pile() -> Scene:
    """Return ten layers of a hundred cubes, randomly turned, 0.8 m apart, to be dropped."""
    rng = np.random.default_rng(1)
    turns = rng.normal(size=(COUNT, 4))
    place = np.stack(np.meshgrid(*[np.arange(10)] * 3, indexing='ij'), axis=-1).reshape(-1, 3)
    return (
        0.8 * (place - [5.0, 5.0, 0.0]) + [0.0, 0.0, 1.0],
        turns / np.linalg.norm(turns, axis=1, keepdims=True),
        np.zeros((COUNT, 3)),
        np.zeros((COUNT, 3)),
    )


def cube_sim_stepper(scene: Scene, collide: bool) -> Callable[[], object]:
    """Return a function that advances a world by a second."""
    world = World(settings(collide))
    world.throw(*scene)
    return lambda: world.step(RATE)


def mujoco_stepper(scene: Scene, collide: bool) -> Callable[[], object] | None:
    """Return the same for MuJoCo, its pyramids and solver at their defaults; None without it."""
    try:
        import mujoco
    except ImportError:
        return None
    bits = 'contype="1" conaffinity="1"' if collide else 'contype="2" conaffinity="1"'
    bodies = []
    for position, turn in zip(scene[0], scene[1], strict=True):
        where = ' '.join(map(repr, map(float, position)))
        how = ' '.join(map(repr, map(float, turn[[3, 0, 1, 2]])))
        bodies.append(
            f'<body pos="{where}" quat="{how}"><freejoint/>'
            f'<geom type="box" size=".25 .25 .25" mass="1" friction=".5 0 0" {bits}/></body>'
        )
    plane = '<geom type="plane" size="0 0 1" friction=".5 0 0" contype="1" conaffinity="3"/>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><size memory="2G"/><option timestep="{1 / RATE}"/>'
        f'<worldbody>{plane}{"".join(bodies)}</worldbody></mujoco>'
    )
    data = mujoco.MjData(model)
    velocities = data.qvel.reshape(-1, 6)
    velocities[:, :3], velocities[:, 3:] = scene[2], scene[3]

    def second() -> None:
        for _ in range(RATE):
            mujoco.mj_step(model, data)

    return second


def main() -> None:
    """Measure second after second, the two in turn, and print."""
    seconds = int(sys.argv[1]) if len(sys.argv) > 1 else SECONDS
    for name, scene, collide in (('thrown', thrown(), False), ('pile', pile(), True)):
        ours, theirs = cube_sim_stepper(scene, collide), mujoco_stepper(scene, collide)
        print(f'\n{name}, {COUNT} cubes, us per step (mean of each second):\n')
        if theirs is None:
            print('MuJoCo is not installed, so there is no ratio.\n')
        print('| second | cube_sim | MuJoCo | ratio |\n|---|---|---|---|')
        sums = [0.0, 0.0]
        for second in range(seconds):
            taken = []
            for advance in (ours, theirs):
                start = time.process_time()
                if advance is not None:
                    advance()
                taken.append((time.process_time() - start) / RATE * 1e6)
            sums = [total + new for total, new in zip(sums, taken, strict=True)]
            print(row(str(second + 1), taken, theirs is not None), flush=True)
        print(row('mean', [total / seconds for total in sums], theirs is not None))


def row(name: str, taken: list[float], both: bool) -> str:
    """Return a row of the table."""
    ours, theirs = taken
    return f'| {name} | {ours:.0f} | ' + (
        f'{theirs:.0f} | {theirs / ours:.1f} |' if both else '| |'
    )


if __name__ == '__main__':
    main()
