"""A run: what is published when, and with which stamps."""

from __future__ import annotations

import numpy as np
import pytest
from support.collecting_outlet import CollectingOutlet
from support.ros_messages import decoded, plain

from cube_sim.messages import events, markers, poses
from cube_sim.physics import PhysicsError, Settings, World
from cube_sim.physics.world import turned_by
from cube_sim.simulation import Scenario, Simulation, Throwing
from cube_sim.simulation.camera import Camera
from cube_sim.simulation.parameters import PHYSICS
from cube_sim.simulation.simulation import steps_at

STEP = 2_000_000
PERIOD = 20_000_000


def make(outlet=None, scenario: str = '', **options) -> tuple[Simulation, CollectingOutlet]:
    """A simulation with a period of ten steps of 2 ms, and its outlet."""
    outlet = outlet or CollectingOutlet()
    simulation = Simulation(
        outlet,
        options.pop('settings', Settings()),
        options.pop('throwing', Throwing()),
        camera=options.pop('camera', None) or Camera(),
        scenario=Scenario.parse(scenario, 'file.yaml'),
        **options,
    )
    return simulation, outlet


def array(time_ns: int, data: bytes) -> np.ndarray:
    """The poses (N, 7) of a PoseArray of that stamp."""
    message = decoded(data, 'geometry_msgs/msg/PoseArray')
    stamp = message.header.stamp
    assert stamp.sec * 10**9 + stamp.nanosec == time_ns
    return np.array(
        [
            [*plain(pose)['position'].values(), *plain(pose)['orientation'].values()]
            for pose in message.poses
        ]
    ).reshape(-1, 7)


def test_at_the_start_everything_latched_is_sent_with_the_stamp_0():
    simulation, outlet = make(frame_id='map', node_name='/here/cube_sim')
    assert [(topic, time_ns) for topic, time_ns, _ in outlet.messages] == [
        ('~/ground', 0),
        ('~/settings', 0),
        ('~/camera/pose', 0),
    ]
    ground = decoded(outlet.of('~/ground')[0][1], 'visualization_msgs/msg/Marker')
    assert ground.header.frame_id == 'map'
    assert len(ground.points) == len(ground.colors) > 1000
    settings = decoded(outlet.of('~/settings')[0][1], 'rcl_interfaces/msg/ParameterEvent')
    assert settings.node == '/here/cube_sim'
    camera = decoded(outlet.of('~/camera/pose')[0][1], 'geometry_msgs/msg/PoseStamped')
    assert camera.header.frame_id == 'map'
    assert sorted(simulation.latched()) == sorted(
        (topic, message) for topic, _, message in outlet.messages
    )


@pytest.mark.parametrize('period', [1, 3, 10])
def test_publications_are_stamped_with_the_multiples_of_the_period(period):
    simulation, outlet = make(period=period)
    for _ in range(5):
        simulation.advance()
    stamps = [n * period * STEP for n in range(1, 6)]
    for topic in ('/clock', '~/poses', '~/markers'):
        assert [time_ns for time_ns, _ in outlet.of(topic)] == stamps
    assert [data for _, data in outlet.of('/clock')] == [events.clock(stamp) for stamp in stamps]
    for time_ns, data in outlet.of('~/poses'):
        assert len(array(time_ns, data)) == 0
    assert simulation.period_ns == period * STEP
    assert simulation.next_publication_ns == 6 * period * STEP


def test_poses_stamped_t_are_the_state_after_the_step_that_ends_at_t():
    simulation, outlet = make(camera=Camera((0, 0, 1), (0.1, -0.2, 0.3, 0.9)))
    twin = World(Settings())
    camera = simulation.camera
    simulation.throw()
    twin.throw(
        camera.position,
        camera.orientation,
        turned_by(camera.orientation, (8, 0, 0)),
        turned_by(camera.orientation, (1, 2, 3)),
    )
    for n in range(1, 60):
        simulation.advance()
        twin.step(10)
        time_ns, data = outlet.of('~/poses')[-1]
        assert time_ns == n * PERIOD
        assert data == poses.pose_array(time_ns, 'world', twin.poses)
        assert outlet.of('~/markers')[-1][1] == markers.cube_markers(
            time_ns, 'world', twin.poses, 0.5
        )


def test_a_throw_is_the_state_before_the_step_at_its_stamp_and_in_the_next_poses():
    simulation, outlet = make(scenario='- {at: 0.024, throw: {}}', settings=Settings(gravity=0.0))
    simulation.advance()
    simulation.throw()
    for _ in range(2):
        simulation.advance()
    thrown = [
        (time_ns, decoded(data, 'nav_msgs/msg/Odometry')) for time_ns, data in outlet.of('~/throws')
    ]
    assert [(time_ns, message.child_frame_id) for time_ns, message in thrown] == [
        (20_000_000, 'cube_0'),
        (24_000_000, 'cube_1'),
    ]
    for time_ns, message in thrown:
        assert message.header.stamp.nanosec == time_ns
        assert message.header.frame_id == 'world'
        assert plain(message.pose.pose) == {
            'position': {'x': 0, 'y': 0, 'z': 1.5},
            'orientation': {'x': 0, 'y': 0, 'z': 0, 'w': 1},
        }
    found = {time_ns: array(time_ns, data) for time_ns, data in outlet.of('~/poses')}
    assert [len(rows) for rows in found.values()] == [0, 2, 2]
    # 8 m/s for the steps that start at 20 ms, or at 24 ms, and end by 40 ms.
    np.testing.assert_allclose(found[40_000_000][:, 0], [0.16, 0.128], rtol=1e-14)


def test_the_twist_of_a_throw_is_in_the_axes_of_the_cube():
    # The camera looks along +y: 8 m/s ahead are +8 m/s in y, a spin about its x is one about y.
    root = 0.5**0.5
    simulation, outlet = make(camera=Camera((0, 0, 5), (0, 0, root, root)))
    assert simulation.throw(speed=8.0, spin=(3, 1, -2)) == 0
    message = decoded(outlet.of('~/throws')[0][1], 'nav_msgs/msg/Odometry')
    assert plain(message.twist.twist) == {
        'linear': {'x': 8, 'y': 0, 'z': 0},
        'angular': {'x': 3, 'y': 1, 'z': -2},
    }
    np.testing.assert_allclose(simulation.world.velocities[0], [0, 8, 0, -1, 3, -2], atol=1e-14)


def test_a_scenario_between_publications_is_played_at_its_own_steps():
    # The first cube flies alone for five steps at g, both for the rest of the period without.
    text = """
- {at: 0.0, throw: {speed: 0, spin: [0, 0, 0]}}
- {at: 0.010, set: {gravity: 0}}
- {at: 0.010, throw: {speed: 1, spin: [0, 0, 0]}}
"""
    simulation, outlet = make(scenario=text)
    simulation.advance()
    assert simulation.world.velocities[:, 2].tolist() == [pytest.approx(-0.0981, abs=1e-15), 0.0]
    assert simulation.world.poses[1, 0] == pytest.approx(0.010, abs=1e-15)
    assert [time_ns for time_ns, _ in outlet.of('~/poses')] == [PERIOD]


def settings_of(parameters) -> dict[str, object]:
    member = {1: 'bool_value', 3: 'double_value', 4: 'string_value', 8: 'double_array_value'}
    return {item.name: plain(getattr(item.value, member[item.value.type])) for item in parameters}


def test_settings_come_at_the_start_and_at_each_change_whole_and_stamped():
    text = '- {at: 0.013, set: {physics_model: impulse, gravity_direction: [0, 0.6, -0.8]}}'
    simulation, outlet = make(scenario=text)
    simulation.advance()
    simulation.configure({'friction': 0.25})
    simulation.configure({'friction': 0.25, 'throw_speed': 3.0})
    simulation.advance()
    assert simulation.throwing.throw_speed == 3.0
    sent = [
        (time_ns, decoded(data, 'rcl_interfaces/msg/ParameterEvent'))
        for time_ns, data in outlet.of('~/settings')
    ]
    assert [time_ns for time_ns, _ in sent] == [0, 14_000_000, 20_000_000]
    start = {
        'physics_model': 'simple',
        'restitution': 0.5,
        'friction': 0.5,
        'tangential_factor': 0.9,
        'gravity': 9.81,
        'gravity_direction': [0.0, 0.0, -1.0],
        'cube_size': 0.5,
        'time_step': 0.002,
    }
    change = {'physics_model': 'impulse', 'gravity_direction': [0.0, 0.6, -0.8]}
    expected = [start, {**start, **change}, {**start, **change, 'friction': 0.25}]
    for index, (time_ns, message) in enumerate(sent):
        assert message.stamp.nanosec == time_ns
        new, changed = settings_of(message.new_parameters), settings_of(message.changed_parameters)
        whole, nothing = (new, changed) if index == 0 else (changed, new)
        assert whole.keys() == PHYSICS.keys()
        assert expected[index].items() <= whole.items()
        assert nothing == {}


@pytest.mark.parametrize(
    'changes',
    [
        {'friction': 0.1, 'restitution': 2.0},
        {'friction': 0.1, 'throw_speed': 1e6},
        {'throw_speed': 1.0, 'physics_model': 'clay'},
        {'throw_speed': 1.0, 'time_step': 0.001},
        {'throw_speed': 1.0, 'time_step': 0.0000000015},
        {'throw_speed': 1.0, 'max_cubes': 0},
    ],
)
def test_a_change_that_cannot_be_is_refused_whole(changes):
    simulation, outlet = make()
    before = len(outlet.messages)
    values = simulation.parameters()
    with pytest.raises(PhysicsError):
        simulation.configure(changes)
    assert simulation.parameters() == values
    assert len(outlet.messages) == before


def test_checking_finds_what_configuring_would_refuse_and_changes_nothing():
    simulation, outlet = make()
    before = simulation.parameters(), len(outlet.messages)
    simulation.check({'friction': 0.1, 'throw_spin': [0, 0, 1]})
    for changes in ({'friction': -1.0}, {'throw_spin': [0, 0]}):
        with pytest.raises(PhysicsError):
            simulation.check(changes)
    assert (simulation.parameters(), len(outlet.messages)) == before


def test_the_parameters_are_the_present_ones():
    simulation, _ = make()
    simulation.configure({'friction': 0.125, 'throw_spin': [3, 2, 1], 'max_cubes': 5})
    values = simulation.parameters()
    assert values.keys() == {*PHYSICS, 'throw_speed', 'throw_spin', 'max_cubes'}
    assert (values['friction'], values['throw_spin'], values['max_cubes']) == (
        0.125,
        (3.0, 2.0, 1.0),
        5,
    )


def test_the_next_model_goes_round_and_is_only_named():
    simulation, outlet = make()
    assert simulation.next_model() == 'impulse'
    assert simulation.world.settings.model == 'simple'
    assert len(outlet.of('~/settings')) == 1


def test_throws_beyond_the_most_cubes_are_refused_and_nothing_is_sent():
    simulation, outlet = make(throwing=Throwing(max_cubes=2))
    assert [simulation.throw(), simulation.throw()] == [0, 1]
    before = len(outlet.messages)
    with pytest.raises(PhysicsError, match='There are 2 cubes already: reset, or raise the para'):
        simulation.throw()
    assert len(outlet.messages) == before
    assert len(simulation.world) == 2
    simulation.reset()
    assert simulation.throw() == 0


def test_a_throw_out_of_range_is_refused_and_nothing_is_sent():
    simulation, outlet = make()
    before = len(outlet.messages)
    with pytest.raises(PhysicsError):
        simulation.throw(speed=float('nan'))
    with pytest.raises(PhysicsError):
        simulation.throw(spin=(1e6, 0, 0))
    assert len(outlet.messages) == before
    assert len(simulation.world) == 0


def test_a_reset_is_told_and_deletes_the_markers_that_vanished_once():
    simulation, outlet = make()
    for _ in range(5):
        simulation.throw()
    simulation.advance()
    simulation.reset()
    simulation.throw()
    simulation.throw()
    for _ in range(2):
        simulation.advance()
    simulation.reset()
    for _ in range(2):
        simulation.advance()
    assert [(time_ns, data) for time_ns, data in outlet.of('~/resets')] == [
        (time_ns, events.header(time_ns, 'world')) for time_ns in (PERIOD, 3 * PERIOD)
    ]
    assert [time_ns for time_ns, _ in outlet.of('/clock')] == [n * PERIOD for n in range(1, 6)]
    shown = []
    for _, data in outlet.of('~/markers'):
        content = decoded(data, 'visualization_msgs/msg/MarkerArray').markers
        shown.append(tuple([marker.id for marker in content if marker.action == a] for a in (0, 2)))
    assert shown == [
        ([0, 1, 2, 3, 4], []),
        ([0, 1], [2, 3, 4]),
        ([0, 1], []),
        ([], [0, 1]),
        ([], []),
    ]


def test_markers_that_vanished_while_nobody_looked_are_deleted_when_somebody_does():
    simulation, outlet = make()
    for _ in range(3):
        simulation.throw()
    simulation.advance()
    outlet.unwanted = {'~/markers'}
    simulation.reset()
    simulation.throw()
    simulation.advance()
    outlet.unwanted = set()
    simulation.advance()
    content = decoded(outlet.of('~/markers')[-1][1], 'visualization_msgs/msg/MarkerArray').markers
    assert [(marker.id, marker.action) for marker in content] == [(0, 0), (1, 2), (2, 2)]


@pytest.mark.parametrize(
    ('topic', 'builder'),
    [
        ('/clock', 'cube_sim.simulation.simulation.events.clock'),
        ('~/poses', 'cube_sim.simulation.simulation.poses.pose_array'),
        ('~/markers', 'cube_sim.simulation.simulation.markers.cube_markers'),
    ],
)
def test_a_message_that_nobody_wants_is_not_even_built(monkeypatch, topic, builder):
    built = []
    simulation, outlet = make(CollectingOutlet(unwanted=[topic]))
    monkeypatch.setattr(builder, lambda *arguments: built.append(arguments) or b'')
    simulation.throw()
    simulation.advance()
    assert built == []
    assert outlet.of(topic) == []
    outlet.unwanted = set()
    simulation.advance()
    assert len(built) == len(outlet.of(topic)) == 1


@pytest.mark.parametrize('end', [1, 10, 25, 30])
def test_a_run_ends_at_its_last_step_and_not_later(end):
    simulation, outlet = make(end=end)
    advanced = 0
    while not simulation.finished:
        simulation.advance()
        advanced += 1
    assert simulation.world.steps == end
    assert advanced == -(-end // 10)
    assert [time_ns for time_ns, _ in outlet.of('~/poses')] == [
        n * PERIOD for n in range(1, end // 10 + 1)
    ]
    before = len(outlet.messages)
    simulation.advance()
    assert simulation.world.steps == end
    assert len(outlet.messages) == before


def test_without_an_end_a_run_is_never_finished():
    simulation, _ = make()
    for _ in range(100):
        simulation.advance()
    assert not simulation.finished


@pytest.mark.parametrize(
    ('seconds', 'step'),
    [(0.0, 0), (0.002, 1), (0.0021, 2), (0.3, 150), (1e9 + 1e-6, 500_000_000_001)],
)
def test_a_time_in_seconds_is_the_first_step_at_or_after_it(seconds, step):
    assert steps_at(seconds, STEP) == step


def test_a_new_period_counts_from_now():
    simulation, outlet = make()
    simulation.advance()
    simulation.set_period(3)
    assert simulation.period_ns == 3 * STEP
    assert simulation.next_publication_ns == 13 * STEP
    simulation.advance()
    simulation.advance()
    simulation.set_period(25)
    simulation.advance()
    stamps = [time_ns // STEP for time_ns, _ in outlet.of('~/poses')]
    assert stamps == [10, 13, 16, 41]


def test_the_period_does_not_change_the_physics():
    def digest(period: int) -> str:
        text = '- {at: 0.1, throw: {}}\n- {at: 0.333, throw: {spin: [9, 8, 7]}}'
        simulation, _ = make(scenario=text, period=period, end=1000)
        while not simulation.finished:
            simulation.advance()
        return simulation.world.digest()

    assert digest(1) == digest(7) == digest(1000) == digest(5000)


def test_what_others_do_with_the_camera_is_told_and_latched():
    simulation, outlet = make()
    simulation.advance()
    simulation.place_camera((1, 2, 3), (0, 0, 0, 2))
    simulation.place_camera(None, (0, 0, 1, 0))
    simulation.fly_camera((1, 0, 0), (0, 0, 0), 0.5)
    with pytest.raises(PhysicsError):
        simulation.place_camera((1, 2, float('inf')), None)
    sent = [
        (time_ns, plain(decoded(data, 'geometry_msgs/msg/PoseStamped'))['pose'])
        for time_ns, data in outlet.of('~/camera/pose')[1:]
    ]
    assert [
        (time_ns, *(list(part.values()) for part in pose.values())) for time_ns, pose in sent
    ] == [
        (PERIOD, [1, 2, 3], [0, 0, 0, 1]),
        (PERIOD, [1, 2, 3], [0, 0, 1, 0]),
        (PERIOD, [0.5, 2, 3], [0, 0, 1, 0]),
    ]
    assert dict(simulation.latched())['~/camera/pose'] == outlet.of('~/camera/pose')[-1][1]


def test_what_is_latched_is_what_was_sent_since_the_last_reset_oldest_first():
    simulation, outlet = make()
    simulation.throw()
    simulation.configure({'friction': 0.1})
    simulation.advance()
    simulation.configure({'friction': 0.2})
    simulation.throw()
    simulation.reset()
    simulation.throw()
    simulation.configure({'friction': 0.3})
    simulation.throw()
    ground, camera, *events_since = simulation.latched()
    assert (ground[0], camera[0]) == ('~/ground', '~/camera/pose')
    assert [topic for topic, _ in events_since] == [
        '~/settings',
        '~/resets',
        '~/throws',
        '~/settings',
        '~/throws',
    ]
    settings = [data for _, data in outlet.of('~/settings')]
    throws = [data for _, data in outlet.of('~/throws')]
    assert [data for topic, data in events_since if topic == '~/settings'] == settings[-2:]
    assert [data for topic, data in events_since if topic == '~/throws'] == throws[-2:]


def test_contacts_are_lines_from_the_points_of_a_resting_cube_along_the_normals():
    # A cube dropped flat rests on its four lower corners: four lines of half a side, upwards.
    simulation, outlet = make(settings=Settings(model='contact'))
    simulation.place_camera((0.0, 0.0, 0.25), (0.0, 0.0, 0.0, 1.0))
    simulation.throw(0.0, (0.0, 0.0, 0.0))
    for _ in range(20):
        simulation.advance()
    marker = decoded(outlet.of('~/contacts')[-1][1], 'visualization_msgs/msg/Marker')
    assert (marker.type, marker.action, len(marker.points)) == (5, 0, 8)
    for start, end in zip(marker.points[::2], marker.points[1::2], strict=True):
        assert (abs(start.x), abs(start.y)) == pytest.approx((0.25, 0.25), abs=1e-6)
        assert (start.z, end.z - start.z) == pytest.approx((0.0, 0.25), abs=1e-6)
    simulation.configure({'physics_model': 'simple'})
    simulation.advance()
    marker = decoded(outlet.of('~/contacts')[-1][1], 'visualization_msgs/msg/Marker')
    assert (marker.action, len(marker.points)) == (2, 0)
