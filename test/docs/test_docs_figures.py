"""The figures on the pages, computed again or read from the code."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from cube_sim.node.node import CMD_VEL_TIMEOUT
from cube_sim.node.topics import DEEP
from cube_sim.physics import Settings, World
from cube_sim.recording import recorder
from cube_sim.simulation.runner import CATCH_UP

DOCS = Path(__file__).parents[2] / 'docs'
PAGE = (DOCS / 'physics.md').read_text(encoding='utf-8')
ROWS = re.findall(r'^\| (\d\.\d) \| (\d\.\d) \| ([\d.]+) % \| (\d+) % \|$', PAGE, re.MULTILINE)


def marked(name: str, page: str = 'physics.md') -> str:
    """The number on the page behind the comment of that name."""
    text = (DOCS / page).read_text(encoding='utf-8')
    found = re.search(rf'<!-- {name} -->([\d.,]+)', text)
    assert found, name
    return found[1]


def energy_gains(restitution: float, friction: float) -> np.ndarray:
    """Relative change of kinetic energy of random impacts; one for each that approaches."""
    rng = np.random.default_rng(1)
    count = 300_000
    q = rng.normal(size=(count, 4))
    q /= np.linalg.norm(q, axis=1, keepdims=True)
    velocity, spin = 3.0 * rng.normal(size=(count, 3)), 5.0 * rng.normal(size=(count, 3))
    settings = Settings(
        model='impulse',
        gravity=0.0,
        restitution=restitution,
        friction=friction,
        time_step_ns=1000,
    )
    x, y, z, w = q.T
    up = np.abs([2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)]).sum(axis=0)
    position = np.zeros((count, 3))
    # A micrometre deep: in 1 µs none gets more than a few times as far.
    position[:, 2] = settings.cube_size / 2 * up - 1e-6
    world = World(settings)
    world.throw(position, q, velocity, spin)

    def energy() -> np.ndarray:
        squares = world.velocities**2
        inertia = settings.cube_size**2 / 6
        return squares[:, :3].sum(axis=1) / 2 + inertia * squares[:, 3:].sum(axis=1) / 2

    before, were = energy(), world.velocities.copy()
    world.step()
    hit = (world.velocities != were).any(axis=1)
    assert 0.45 < hit.mean() < 0.55
    return energy()[hit] / before[hit] - 1


def test_the_page_has_a_table_of_energy_gains():
    assert len(ROWS) >= 4


@pytest.mark.parametrize(('restitution', 'friction', 'share', 'largest'), ROWS)
def test_impulse_gains_energy_as_often_as_the_page_says(restitution, friction, share, largest):
    gains = energy_gains(float(restitution), float(friction))
    # To the last digit that is shown.
    assert 100 * (gains > 1e-9).mean() == pytest.approx(float(share), abs=0.051)
    assert 100 * max(0.0, gains.max()) == pytest.approx(float(largest), abs=0.51)


def test_a_flat_slide_under_impulse_stops_where_the_page_says():
    world = World(Settings(model='impulse', restitution=0.0, friction=0.5))
    world.throw((0, 0, 0.25), (0, 0, 0, 1), (3, 0, 0))
    world.step(2000)
    assert np.abs(world.velocities).max() < 1e-9
    assert f'{world.poses[0, 0]:.3f}' == marked('slide')


def test_a_thrown_cube_hops_at_rest_as_fast_as_the_page_says():
    world = World(Settings(model='impulse'))
    world.throw((0, 0, 1.5), (0, 0, 0, 1), (8, 0, 0), (1, 2, 3))
    world.step(4000)
    fastest = 0.0
    for _ in range(1000):
        world.step()
        fastest = max(fastest, np.abs(world.velocities[0, :3]).max())
    assert f'{fastest:.3f}' == marked('rest')


def test_the_limits_on_the_pages_are_those_of_the_code():
    assert float(marked('flush', 'recording.md')) == recorder.FLUSH_PERIOD
    assert int(marked('queue', 'recording.md')) == recorder.QUEUE_BYTES / 2**20
    assert float(marked('cmd_vel', 'interface.md')) == CMD_VEL_TIMEOUT
    assert float(marked('catch up', 'interface.md')) == CATCH_UP
    assert marked('deep', 'interface.md') == f'{DEEP:,}'
