"""The report of a run that is simulated again, held to what the laws say."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from support.bags import drop, record_run, throws

from cube_sim.analysis.cubes import rest_ns
from cube_sim.analysis.energy import energies, flight_gain
from cube_sim.analysis.findings import REPLAY
from cube_sim.analysis.run import find_out
from cube_sim.analysis.summary import budget, regimes
from cube_sim.physics import Settings, World
from cube_sim.recording.reader import BagReader


def found_in(path, **options):
    with BagReader(path) as reader:
        return find_out(reader, **options)


@pytest.mark.parametrize(('restitution', 'friction'), [(0.3, 0.2), (0.5, 0.5), (0.8, 3.0)])
def test_measured_under_impulse_are_the_coefficients_set(tmp_path, restitution, friction):
    bag = record_run(
        tmp_path / 'bag',
        throws(12),
        2.0,
        model='impulse',
        restitution=restitution,
        friction=friction,
    )
    found = found_in(bag)
    measures = found.measures()
    assert found.method == REPLAY
    assert len(found.bounces) > 20
    np.testing.assert_allclose(measures.restitution, restitution, atol=1e-9)
    certain = ~measures.friction_is_bound & np.isfinite(measures.friction)
    np.testing.assert_allclose(measures.friction[certain], friction, atol=1e-9)
    bounds = measures.friction[measures.friction_is_bound]
    assert np.all(bounds <= friction + 1e-9)


def test_what_a_scenario_sets_at_the_start_is_what_the_run_began_with(tmp_path):
    scenario = (
        '- {at: 0.0, set: {physics_model: contact, restitution: 0.3}}\n'
        '- {at: 0.0, throw: {}}\n'
        '- {at: 1.0, set: {restitution: 0.6}}\n'
    )
    found = found_in(record_run(tmp_path / 'bag', scenario, 2.0))
    assert found.settings_from_ns == [0, 1_000_000_000]
    assert [record.model for record in found.settings] == ['contact', 'contact']
    assert [record.restitution for record in found.settings] == [0.3, 0.6]


def test_without_friction_the_contact_point_rebounds_at_e_times_its_impact_speed(tmp_path):
    bag = record_run(tmp_path / 'bag', throws(12), 2.0, model='impulse', friction=0.0)
    measures = found_in(bag).measures()
    np.testing.assert_allclose(measures.restitution_at_contact, 0.5, atol=1e-9)


def test_measured_under_simple_are_restitution_and_tangential_factor(tmp_path):
    bag = record_run(
        tmp_path / 'bag', throws(12), 2.0, model='simple', restitution=0.7, tangential_factor=0.6
    )
    measures = found_in(bag).measures()
    np.testing.assert_allclose(measures.restitution, 0.7, atol=1e-9)
    slides = np.isfinite(measures.friction) | (measures.centre_impact_speed > 1.0)
    np.testing.assert_allclose(measures.tangential_factor[slides], 0.6, atol=1e-9)
    assert not np.isfinite(measures.friction).any()


@pytest.mark.parametrize('model', ['simple', 'impulse'])
def test_apexes_after_a_flat_drop_are_e_squared_times_the_height_before(tmp_path, model):
    bag = record_run(
        tmp_path / 'bag', drop(2.25), 3.0, period=40, model=model, time_step_ns=500_000
    )
    bounces = found_in(bag).bounces.records
    heights = np.array([2.0, *(bounces['apex'] - 0.25)])[:4]
    # The speed of an impact is late by up to g dt, and its height by the way of one step.
    np.testing.assert_allclose(heights[1:] / heights[:-1], 0.25, rtol=0.02)


def test_a_flat_drop_comes_to_rest_when_the_geometric_series_says(tmp_path):
    bag = record_run(tmp_path / 'bag', drop(2.25), 4.0, period=40, time_step_ns=500_000)
    (cube,) = found_in(bag).cubes.records
    e, fall = 0.5, math.sqrt(2 * 2.0 / 9.81)
    until_rest = fall * (1 + e) / (1 - e)
    # It counts as at rest when its bounces are slower than 0.05 m/s: that much earlier.
    tail = 2 * 0.05 / 9.81 / (1 - e)
    assert rest_ns(cube) / 1e9 == pytest.approx(until_rest, abs=tail + 0.02)


def test_times_and_places_are_those_of_the_step_of_contact(tmp_path):
    bag = record_run(tmp_path / 'bag', drop(2.0), 2.0)
    bounces = found_in(bag).bounces.records
    world = World(Settings())
    world.throw((0.0, 0.0, 2.0), (0.0, 0.0, 0.0, 1.0))
    struck = []
    for _ in range(1000):
        falling = world.velocities[0, 2] < 0.0
        world.step()
        if falling and world.velocities[0, 2] > 0.0:
            struck.append((world.time_ns, float(world.velocities[0, 2])))
    assert [(int(b['time_ns']), float(b['after'][2])) for b in bounces] == struck[: len(bounces)]
    assert len(bounces) >= 5


def test_the_deepest_penetration_is_what_the_cube_was_pushed_out_by(tmp_path):
    bag = record_run(tmp_path / 'bag', drop(2.0), 2.0)
    found = found_in(bag)
    (cube,) = found.cubes.records
    assert cube['deepest'] == found.bounces.records['depth'].max()
    assert 0.0 < cube['deepest'] <= math.sqrt(2 * 9.81 * 1.75) * 0.002 * 1.01


def test_flight_loses_half_g_squared_dt_squared_in_every_step(tmp_path):
    bag = record_run(tmp_path / 'bag', drop(100.0), 2.0)
    (cube,) = found_in(bag).cubes.records
    lost = (cube['thrown_energy'] - cube['end_energy']).sum()
    assert cube['flight'] == pytest.approx(-1000 * 0.5 * (9.81 * 0.002) ** 2, rel=1e-12)
    assert lost == pytest.approx(-cube['flight'], abs=1e-9)
    assert flight_gain(Settings()) == -0.5 * (9.81 * 0.002) ** 2


def test_energies_are_mgh_half_mv2_and_half_iw2():
    pose = np.array([[1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0]])
    velocity = np.array([[1.0, 2.0, 2.0, 0.0, 3.0, 4.0]])
    split = energies(pose, velocity, np.array([0.0, 0.0, -10.0]), 0.6)
    np.testing.assert_allclose(split, [[30.0, 4.5, 0.5 * 0.06 * 25.0]])


EVENTFUL = (
    throws(6, every=0.1)
    + '- {at: 0.9, set: {physics_model: impulse}}\n'
    + '- {at: 1.1, set: {gravity: 5.0}}\n'
    + '- {at: 1.5, reset: {}}\n'
    + '- {at: 1.6, throw: {}}\n'
    + '- {at: 1.8, set: {gravity_direction: [0.3, 0.0, -1.0], cube_size: 0.4}}\n'
)


def test_the_energy_budget_closes_through_resets_and_changes_of_settings(tmp_path):
    found = found_in(record_run(tmp_path / 'bag', EVENTFUL, 3.0))
    total = budget(found)
    assert total.thrown > 100.0
    assert total.changed != 0.0
    assert total.removed != 0.0
    assert abs(total.residue) < 1e-9 * total.thrown
    cubes = found.cubes.records
    names = ('flight', 'lift', 'bounced', 'touched', 'changed')
    gained = sum(cubes[name] for name in names)
    change = cubes['end_energy'].sum(axis=1) - cubes['thrown_energy'].sum(axis=1)
    np.testing.assert_allclose(gained, change, atol=1e-9)


def test_a_model_switch_in_flight_makes_two_regimes(tmp_path):
    scenario = throws(6, every=0.1) + '- {at: 1.2, set: {physics_model: impulse}}\n'
    rows = regimes(found_in(record_run(tmp_path / 'bag', scenario, 3.0)))
    assert [row.settings.model for row in rows] == ['simple', 'impulse']
    assert all(row.restitution.median == pytest.approx(0.5, abs=1e-9) for row in rows)
    assert rows[0].tangential_factor.median == pytest.approx(0.9, abs=1e-9)


def test_cubes_after_a_reset_are_others(tmp_path):
    found = found_in(record_run(tmp_path / 'bag', EVENTFUL, 3.0))
    cubes = found.cubes.records
    assert cubes['generation'].tolist() == [0] * 6 + [1]
    assert cubes['removed'].tolist() == [True] * 6 + [False]
    assert found.resets_ns == [1_500_000_000]
    assert cubes['ended_ns'][0] == 1_500_000_000


def test_a_throw_is_reported_as_it_was_made(tmp_path):
    scenario = '- {at: 0.3, throw: {speed: 6.0, spin: [1, 2, 3]}}\n'
    (cube,) = found_in(record_run(tmp_path / 'bag', scenario, 1.0)).cubes.records
    assert cube['thrown_ns'] == 300_000_000
    assert cube['pose'].tolist() == [0.0, 0.0, 1.5, 0.0, 0.0, 0.0, 1.0]
    assert cube['velocity'].tolist() == [6.0, 0.0, 0.0, 1.0, 2.0, 3.0]


def test_a_gap_in_the_poses_hides_nothing_of_a_run_that_is_simulated_again(tmp_path):
    whole = found_in(record_run(tmp_path / 'whole', throws(4), 2.0))
    holed = found_in(record_run(tmp_path / 'holed', throws(4), 2.0, gap=(0.5, 1.5)))
    assert holed.method == REPLAY
    assert holed.messages < whole.messages
    assert np.array_equal(holed.bounces.records['time_ns'], whole.bounces.records['time_ns'])


def test_the_trace_is_bounded_however_long_the_run(monkeypatch, tmp_path):
    monkeypatch.setattr('cube_sim.analysis.trace.FRAMES', 50)
    found = found_in(record_run(tmp_path / 'bag', throws(3), 4.0))
    frames = found.trace.frames
    assert found.messages == 200
    assert 25 <= len(frames) <= 50
    assert len({b.time_ns - a.time_ns for a, b in itertools.pairwise(frames)}) == 1


def test_a_model_with_a_flight_of_its_own_is_measured_without_knowing_its_integrator(
    tmp_path, monkeypatch
):
    bag = record_run(tmp_path / 'bag', throws(8), 2.0, model='impulse')
    known = found_in(bag)
    for module in ('energy', 'observation'):
        monkeypatch.setattr(f'cube_sim.analysis.{module}.SEMI_IMPLICIT', ())
    found = found_in(bag)
    assert np.array_equal(found.bounces.records['time_ns'], known.bounces.records['time_ns'])
    np.testing.assert_allclose(found.measures().restitution, 0.5, atol=1e-9)
