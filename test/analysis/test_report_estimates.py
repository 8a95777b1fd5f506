"""What poses alone tell, held to truths that are known otherwise."""

from __future__ import annotations

import numpy as np
import pytest
from support.bags import drop, record_poses, record_run, throws

from cube_sim.analysis.cubes import rest_ns
from cube_sim.analysis.error_bars import error_bars
from cube_sim.analysis.findings import POSES, REPLAY
from cube_sim.analysis.run import find_out
from cube_sim.analysis.sampling import FLIGHT, rotation_vectors, samples
from cube_sim.physics import Settings
from cube_sim.recording import RecordingError
from cube_sim.recording.reader import BagReader

GRAVITY = np.array([0.0, 0.0, -9.81])
UPRIGHT = (0.0, 0.0, 0.0, 1.0)


def found_in(path, **options):
    with BagReader(path) as reader:
        return find_out(reader, **options)


def bounced(time, e=0.6, kept=0.8):
    """Return the pose of a cube of 0.5 m on exact parabolas: thrown, and bouncing once at 1 s."""
    at_one = np.array([2.0, -1.0, 0.25])
    before = np.array([3.0, 1.0, -5.0])
    after = np.array([3.0 * kept, 1.0 * kept, 5.0 * e])
    velocity = before if time < 1.0 else after
    t = time - 1.0
    return [*(at_one + velocity * t + 0.5 * GRAVITY * t * t), *UPRIGHT]


def frames_of(motion, rate, seconds):
    count = round(rate * seconds) + 1
    return [(round(i * 1e9 / rate), np.array([motion(i / rate)])) for i in range(count)]


@pytest.mark.parametrize('rate', [50, 73, 200])
def test_a_bounce_between_exact_parabolas_is_found_to_rounding(tmp_path, rate):
    bag = record_poses(tmp_path / 'bag', frames_of(bounced, rate, 1.4))
    found = found_in(bag, cube_size=0.5, gravity=9.81)
    assert found.method == POSES
    (bounce,) = found.bounces.records
    measures = found.measures()
    assert bounce['time_ns'] == pytest.approx(1_000_000_000, abs=100)
    np.testing.assert_allclose(bounce['position'], [2.0, -1.0, 0.25], atol=1e-7)
    np.testing.assert_allclose(bounce['before'][:3], [3.0, 1.0, -5.0], atol=1e-6)
    assert measures.restitution[0] == pytest.approx(0.6, abs=1e-6)
    assert measures.tangential_factor[0] == pytest.approx(0.8, abs=1e-6)
    (cube,) = found.cubes.records
    np.testing.assert_allclose(cube['velocity'][:3], [3.0, 1.0, -5.0 + 9.81], atol=1e-6)
    assert cube['apex'] == pytest.approx(0.25 + 25.0 / (2 * 9.81), abs=1e-6)
    assert bounce['apex'] == pytest.approx(0.25 + 9.0 / (2 * 9.81), abs=1e-6)


@pytest.mark.parametrize('model', ['simple', 'impulse'])
@pytest.mark.parametrize(('rate', 'step_ns'), [(50, 2_000_000), (200, 2_500_000)])
def test_nine_of_ten_estimates_are_within_the_stated_error_bars(tmp_path, model, rate, step_ns):
    bag = record_run(
        tmp_path / 'bag',
        throws(60, seed=7, every=0.01),
        3.0,
        period=round(1e9 / rate) // step_ns,
        model=model,
        time_step_ns=step_ns,
    )
    exact, estimated = found_in(bag), found_in(bag, from_poses=True)
    assert (exact.method, estimated.method) == (REPLAY, POSES)
    ours, theirs = estimated.bounces.records, exact.bounces.records
    assert len(ours) > 100
    bars = error_bars(estimated.period_ns)
    assert bars.rate_hz == rate
    pairs = []
    for index, bounce in enumerate(ours):
        same = np.flatnonzero(theirs['cube'] == bounce['cube'])
        pairs.append((index, same[np.abs(theirs['time_ns'][same] - bounce['time_ns']).argmin()]))
    mine, true = np.array(pairs).T
    seen, known = estimated.measures(), exact.measures()
    places = ours['position'] + ours['arm'], theirs['position'] + theirs['arm']
    off = {
        'time_s': (ours['time_ns'][mine] - theirs['time_ns'][true]) / 1e9,
        'place_m': np.linalg.norm((places[0][mine] - places[1][true])[:, :2], axis=1),
        'restitution': seen.restitution[mine] - known.restitution[true],
        'spin_rad_s': np.linalg.norm(ours['after'][mine, 3:] - theirs['after'][true, 3:], axis=1),
    }
    if model == 'simple':
        off['speed_m_s'] = seen.centre_impact_speed[mine] - known.centre_impact_speed[true]
        off['tangential_factor'] = seen.tangential_factor[mine] - known.tangential_factor[true]
    else:
        off['speed_m_s'] = seen.impact_speed[mine] - known.impact_speed[true]
        certain = ~(seen.friction_is_bound[mine] | known.friction_is_bound[true])
        off['friction'] = (seen.friction[mine] - known.friction[true])[certain]
    for name, values in off.items():
        values = values[np.isfinite(values)]
        assert np.mean(np.abs(values) <= getattr(bars, name)) >= 0.9, name


def test_bounces_too_close_to_tell_apart_are_counted_and_not_guessed(tmp_path):
    bag = record_run(tmp_path / 'bag', drop(2.0), 4.0)
    exact, estimated = found_in(bag), found_in(bag, from_poses=True)
    assert 3 <= len(estimated.bounces) < len(exact.bounces)
    # The last flight that is seen has three poses, 0.04 s, and the one after it fewer.
    (stretch,) = estimated.unclear.records
    (cube,) = estimated.cubes.records
    missed = exact.bounces.records['time_ns'][len(estimated.bounces) :]
    assert estimated.bounces.records['time_ns'][-1] < stretch['start_ns'] < missed[0]
    assert stretch['end_ns'] >= rest_ns(cube)
    np.testing.assert_allclose(estimated.measures().restitution, 0.5, atol=0.03)
    assert rest_ns(cube) == pytest.approx(rest_ns(exact.cubes.records[0]), abs=60_000_000)


def test_what_happened_in_a_gap_is_unclear(tmp_path):
    scenario = drop(3.0)
    whole = found_in(record_run(tmp_path / 'whole', scenario, 2.0), from_poses=True)
    first = whole.bounces.records['time_ns'][0] / 1e9
    gap = (first - 0.1, first + 0.1)
    holed = found_in(record_run(tmp_path / 'holed', scenario, 2.0, gap=gap), from_poses=True)
    assert len(holed.bounces) == len(whole.bounces) - 1
    stretches = holed.unclear.records
    assert stretches['start_ns'][0] / 1e9 == pytest.approx(gap[0], abs=0.021)
    assert stretches['end_ns'][0] / 1e9 == pytest.approx(gap[1], abs=0.021)


def test_two_contacts_between_two_poses_are_not_taken_for_one(tmp_path):
    bag = record_run(tmp_path / 'bag', throws(40, seed=3), 4.0, model='impulse')
    exact, estimated = found_in(bag), found_in(bag, from_poses=True)
    theirs = exact.bounces.records
    for bounce in estimated.bounces.records:
        same = theirs['time_ns'][theirs['cube'] == bounce['cube']]
        since = bounce['time_ns'] - bounce['time_ns'] % 20_000_000
        assert np.sum((same > since) & (same <= since + 20_000_000)) <= 1


def test_fewer_cubes_than_before_are_a_reset(tmp_path):
    scenario = throws(3, every=0.1) + '- {at: 1.0, reset: {}}\n- {at: 1.2, throw: {}}\n'
    found = found_in(record_run(tmp_path / 'bag', scenario, 2.0), from_poses=True)
    assert found.cubes.records['generation'].tolist() == [0, 0, 0, 1]
    # The last poses that still had the cubes.
    assert found.resets_ns == [1_000_000_000]


def test_noisy_poses_are_understood_when_the_noise_is_told(tmp_path):
    random = np.random.default_rng(5)
    frames = [
        (time_ns, poses + np.array([*random.normal(scale=2e-4, size=3), 0, 0, 0, 0]))
        for time_ns, poses in frames_of(bounced, 100, 1.4)
    ]
    bag = record_poses(tmp_path / 'bag', frames)
    assert len(found_in(bag).bounces) == 0
    found = found_in(bag, noise=2e-4)
    (bounce,) = found.bounces.records
    assert bounce['time_ns'] / 1e9 == pytest.approx(1.0, abs=1e-3)
    assert found.measures().restitution[0] == pytest.approx(0.6, abs=5e-3)


def test_velocities_on_a_parabola_are_exact_up_to_its_last_pose():
    frames = frames_of(bounced, 50, 1.4)
    for sample in samples(frames, GRAVITY):
        time = sample.time_ns / 1e9
        expected = (bounced(time + 1e-6)[2] - bounced(time)[2]) / 1e-6
        assert sample.source[0] == FLIGHT
        assert sample.velocities[0, 2] == pytest.approx(expected, abs=1e-4)


def test_rotation_vectors_take_the_shorter_way():
    half = np.array([0.3, -0.2, 0.6])
    angle = np.linalg.norm(half)
    second = np.array([[*(half / angle * np.sin(angle)), np.cos(angle)]])
    first = np.array([UPRIGHT])
    np.testing.assert_allclose(rotation_vectors(first, second), [2 * half], atol=1e-12)
    np.testing.assert_allclose(rotation_vectors(first, -second), [2 * half], atol=1e-12)
    np.testing.assert_allclose(rotation_vectors(second, second), [[0, 0, 0]], atol=1e-12)


def test_size_and_gravity_that_nobody_told_are_named(tmp_path):
    bag = record_poses(tmp_path / 'bag', frames_of(bounced, 50, 1.4))
    (note,) = found_in(bag).notes
    assert 'cube size of 0.5 m' in note
    assert 'gravity of 9.81 m/s^2' in note
    assert found_in(bag, cube_size=0.5, gravity=9.81).notes == []
    with pytest.raises(RecordingError, match='cube_size'):
        found_in(bag, cube_size=-1.0)


def test_poses_that_are_not_those_of_the_simulation_are_believed(tmp_path):
    own = record_run(tmp_path / 'own', drop(2.0), 1.0)
    assert found_in(own).method == REPLAY
    gravity = {'gravity': 9.81 * (1 + 1e-9)}
    other = record_run(tmp_path / 'other', drop(2.0), 1.0, **gravity)
    mixed = _with_poses_of(own, other, tmp_path / 'mixed')
    found = found_in(mixed)
    assert found.method == POSES
    assert 'from 0.020 s on the recorded poses are not those' in found.notes[0]


def _with_poses_of(settings, poses, path):
    from support.bags import TOPICS

    from cube_sim.recording import BagWriter

    with BagReader(settings) as first, BagReader(poses) as second, BagWriter(path, TOPICS) as out:
        rest = [name for name in first.topics if not name.endswith('/poses')]
        messages = [*first.messages(rest), *second.messages(['/cube_sim/poses'])]
        for message in sorted(messages, key=lambda message: message.time_ns):
            out.write(message.topic, message.time_ns, bytes(message.data))
    return path


@pytest.mark.parametrize('count', [0, 1, 2])
def test_bags_of_hardly_any_poses_have_no_bounces(tmp_path, count):
    bag = record_poses(tmp_path / 'bag', frames_of(bounced, 50, 1.0)[:count])
    found = found_in(bag)
    assert (found.messages, len(found.bounces)) == (count, 0)
    assert len(found.cubes) == min(count, 1)


def test_settings_hold_from_their_time_also_for_estimates(tmp_path):
    scenario = throws(20, every=0.01) + '- {at: 1.0, set: {restitution: 0.9}}\n'
    found = found_in(record_run(tmp_path / 'bag', scenario, 2.5), from_poses=True)
    assert [record.restitution for record in found.settings] == [0.5, 0.9]
    bounces = found.bounces.records
    assert np.array_equal(bounces['settings'], (bounces['time_ns'] >= 1e9).astype(int))
    assert Settings().restitution == 0.5
