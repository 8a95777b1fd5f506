"""Scenarios: what they may say, and when it takes effect."""

from __future__ import annotations

import pytest
from support.collecting_outlet import CollectingOutlet
from support.ros_messages import decoded, plain

from cube_sim.physics import MODELS, Settings
from cube_sim.simulation import Scenario, ScenarioError, Simulation, Throwing
from cube_sim.simulation.camera import Camera
from cube_sim.simulation.parameters import CHANGEABLE
from cube_sim.simulation.scenario import Place, Reset, Set, Throw, packaged_scenarios

PLAIN = 'a plain YAML value is needed'
ODOMETRY = 'nav_msgs/msg/Odometry'


def run(text: str, steps: int, **options):
    """Run a scenario with steps of 2 ms; return outlet, simulation, reports, announcements."""
    reports: list[str] = []
    announced: list[object] = []
    outlet = CollectingOutlet()
    options.setdefault('throwing', Throwing())
    simulation = Simulation(
        outlet,
        Settings(),
        camera=Camera(),
        scenario=Scenario.parse(text, 'file.yaml'),
        period=10,
        end=steps,
        report=reports.append,
        announce=announced.append,
        **options,
    )
    while not simulation.finished:
        simulation.advance()
    return outlet, simulation, reports, announced


@pytest.mark.parametrize(
    ('at', 'step'),
    [
        (0.0, 0),
        (0.002, 1),
        (0.001, 1),
        (0.0000001, 1),
        (0.0199999, 10),
        (0.02, 10),
        (0.020000001, 11),
        (0.031, 16),
        # Not a float: 0.3 is a little less, 0.07 a little more; the nearest nanosecond is meant.
        (0.3, 150),
        (0.07, 35),
        (0.058, 29),
    ],
)
def test_an_entry_takes_effect_before_the_first_step_at_or_after_its_time(at, step):
    outlet, _, reports, _ = run(f'- {{at: {at:.9f}, throw: {{}}}}', 200)
    assert [time_ns for time_ns, _ in outlet.of('~/throws')] == [step * 2_000_000]
    assert reports == []


def test_entries_of_one_time_keep_their_order_and_others_are_sorted():
    text = """
- {at: 0.1, throw: {speed: 3}}
- {at: 0.05, throw: {speed: 1}}
- {at: 0.05, set: {throw_speed: 2}}
- {at: 0.05, throw: {}}
- {at: 0.05, set: {throw_speed: 9}}
- {at: 0.0, throw: {}}
"""
    outlet, _, _, _ = run(text, 100)
    speeds = [decoded(data, ODOMETRY).twist.twist.linear.x for _, data in outlet.of('~/throws')]
    assert speeds == [8.0, 1.0, 2.0, 3.0]


def test_speed_and_spin_override_those_of_the_settings_for_one_throw():
    text = """
- {at: 0.0, throw: {speed: 6.5, spin: [4, -5, 6.25]}}
- {at: 0.0, throw: {speed: -2}}
- {at: 0.0, throw: {spin: [0, 0, 1e1]}}
- {at: 0.0, throw: {}}
- {at: 0.0, throw: }
"""
    outlet, _, _, _ = run(text, 10)
    twists = [plain(decoded(data, ODOMETRY).twist.twist) for _, data in outlet.of('~/throws')]
    assert [
        (twist['linear']['x'], *(twist['angular'][axis] for axis in 'xyz')) for twist in twists
    ] == [(6.5, 4, -5, 6.25), (-2, 1, 2, 3), (8, 0, 0, 10), (8, 1, 2, 3), (8, 1, 2, 3)]


def test_every_action_does_what_it_says():
    text = """
- {at: 0.0, camera: {position: [1, 2, 3], orientation: [0, 0, 1, 0]}}
- {at: 0.01, camera: {position: [4, 5, 6]}}
- {at: 0.02, camera: {orientation: [0, 0, 0, 2]}}
- {at: 0.03, throw: {}}
- {at: 0.04, set: {physics_model: impulse, gravity_direction: [0, 3, -4], max_cubes: 7}}
- {at: 0.05, reset: {}}
- {at: 0.06, reset: }
"""
    outlet, simulation, reports, announced = run(text, 100)
    camera = [
        (time_ns, list(plain(decoded(data, 'geometry_msgs/msg/PoseStamped'))['pose'].values()))
        for time_ns, data in outlet.of('~/camera/pose')
    ]
    assert [(t, *(list(part.values()) for part in parts)) for t, parts in camera] == [
        (0, [0, 0, 1.5], [0, 0, 0, 1]),
        (0, [1, 2, 3], [0, 0, 1, 0]),
        (10_000_000, [4, 5, 6], [0, 0, 1, 0]),
        (20_000_000, [4, 5, 6], [0, 0, 0, 1]),
    ]
    assert [time_ns for time_ns, _ in outlet.of('~/settings')] == [0, 40_000_000]
    assert simulation.world.settings == Settings(
        model='impulse', gravity_direction=(0.0, 0.6, -0.8)
    )
    assert simulation.throwing.max_cubes == 7
    assert [time_ns for time_ns, _ in outlet.of('~/resets')] == [50_000_000, 60_000_000]
    assert len(simulation.world) == 0
    assert announced == [
        # As it was applied: of unit length.
        {'physics_model': 'impulse', 'gravity_direction': (0.0, 0.6, -0.8), 'max_cubes': 7}
    ]
    assert reports == []


def test_what_cannot_be_done_is_reported_with_its_line_and_the_run_goes_on():
    text = '\n'.join(
        (
            '- {at: 0.0, set: {max_cubes: 1}}',
            '- {at: 0.0, throw: {}}',
            '',
            '- {at: 0.02, throw: {}}',
            '- {at: 0.04, reset: {}}',
            '- {at: 0.04, throw: {}}',
        )
    )
    outlet, simulation, reports, _ = run(text, 100)
    assert reports == [
        'file.yaml:4: There are 1 cubes already: reset, or raise the parameter max_cubes.'
    ]
    assert [time_ns for time_ns, _ in outlet.of('~/throws')] == [0, 40_000_000]
    assert simulation.finished


def test_an_entry_at_the_end_or_later_is_not_played():
    outlet, _, _, _ = run('- {at: 0.19, throw: {}}\n- {at: 0.2, throw: {}}', 100)
    assert [time_ns for time_ns, _ in outlet.of('~/throws')] == [190_000_000]


def test_entries_keep_their_times_actions_and_lines():
    text = """# a comment
- at: 0.5
  throw:
    speed: 1
- {at: 0.25, set: {friction: 1e-1, physics_model: impulse}}

- {at: 1.001, reset: {}}
- {at: 3, camera: {position: [0, 0, 1]}}
- {at: 1e1, reset: {}}
"""
    entries = Scenario.parse(text).entries
    assert [(entry.time_ns, entry.line, entry.action) for entry in entries] == [
        (250_000_000, 5, Set({'friction': 0.1, 'physics_model': 'impulse'})),
        (500_000_000, 2, Throw(1.0, None)),
        # As a float a little less: the nearest nanosecond is meant.
        (1_001_000_000, 7, Reset()),
        (3_000_000_000, 8, Place((0.0, 0.0, 1.0), None)),
        (10_000_000_000, 9, Reset()),
    ]


@pytest.mark.parametrize('text', ['', '\n\n', '# nothing\n', '[]', '--- []\n'])
def test_an_empty_file_is_a_scenario_in_which_nothing_happens(text):
    assert Scenario.parse(text).entries == ()


@pytest.mark.parametrize(
    ('line', 'text', 'parts'),
    [
        # A mistyped key is answered with those there are.
        (1, '- {at: 0, thorw: {}}', ["no 'thorw'", 'allowed: at, camera, throw, set, reset']),
        (1, '- {at: 0, throw: {sped: 1}}', ["no 'sped'", 'allowed: speed, spin']),
        (1, '- {at: 0, camera: {pose: 1}}', ["no 'pose'", 'allowed: position, orientation']),
        (1, '- {at: 0, reset: {hard: 1}}', ["no 'hard'", 'allowed: nothing']),
        (1, '- {at: 0, set: {restitutoin: 1}}', ["no 'restitutoin'", ', '.join(CHANGEABLE)]),
        (1, '- {at: 0, set: {time_step: 0.1}}', ["no 'time_step'"]),
        (1, '- {at: 0, [1, 2]: {}}', ['allowed: at, camera, throw, set, reset']),
        # Values that the records refuse.
        (1, '- {at: 0, set: {physics_model: clay}}', ["'clay'", ', '.join(MODELS)]),
        (1, '- {at: 0, set: {restitution: 2}}', ['restitution is 2', 'from 0 to 1']),
        (1, '- {at: 0, set: {restitution: high}}', ["restitution is 'high'", 'from 0 to 1']),
        (1, '- {at: 0, set: {restitution: .nan}}', ['restitution is nan', 'from 0 to 1']),
        (1, '- {at: 0, set: {restitution: [1]}}', ['restitution is [1]', 'from 0 to 1']),
        (1, '- {at: 0, set: {gravity_direction: [0, 0]}}', ['gravity_direction', 'x, y, z']),
        (1, '- {at: 0, set: {gravity_direction: [0, 0, 0]}}', ['gravity_direction is zero']),
        (1, '- {at: 0, set: {max_cubes: 1.5}}', ['max_cubes is 1.5', 'a whole number']),
        (1, '- {at: 0, set: {max_cubes: 0}}', ['max_cubes is 0', 'from 1 to']),
        (1, '- {at: 0, throw: {speed: 1e9}}', ['speed is', 'from -1000 to 1000 m/s']),
        (1, '- {at: 0, throw: {speed: fast}}', ["speed is 'fast'", 'a number']),
        (1, '- {at: 0, throw: {speed: yes}}', ['speed is True', 'a number']),
        (1, '- {at: 0, throw: {spin: [1, 2]}}', ['spin needs a list of 3 numbers']),
        (1, '- {at: 0, throw: {spin: 3}}', ['spin needs a list of 3 numbers']),
        (1, '- {at: 0, throw: {spin: [1, 2, x]}}', ["spin is 'x'", 'a number']),
        (1, '- {at: 0, throw: {spin: [1, 2, .inf]}}', ['spin', 'finite']),
        (1, '- {at: 0, camera: {position: [1, 2, 3, 4]}}', ['position needs a list of 3 numbers']),
        (1, '- {at: 0, camera: {orientation: [0, 0, 1]}}', ['orientation', 'a list of 4 numbers']),
        (1, '- {at: 0, camera: {orientation: [0, 0, 0, 0]}}', ['camera orientation is zero']),
        (1, '- {at: 0, camera: {position: [0, 0, 1e8]}}', ['camera position', 'at most 1e+07 m']),
        # The time.
        (1, '- {throw: {}}', ['needs "at" and exactly one of camera, throw, set, reset']),
        (1, '- {at: 0}', ['needs "at" and exactly one of camera, throw, set, reset']),
        (1, '- {at: 0, throw: {}, reset: {}}', ['exactly one of camera, throw, set, reset']),
        (1, '- {at: -0.1, throw: {}}', ['at is -0.1', 'seconds from 0 to 1e+09']),
        (1, '- {at: .nan, throw: {}}', ['at is nan', 'seconds from 0 to 1e+09']),
        (1, '- {at: 2e9, throw: {}}', ['at is 2000000000.0', 'seconds from 0 to 1e+09']),
        (1, '- {at: soon, throw: {}}', ["at is 'soon'", 'a number']),
        (1, '- {at: , throw: {}}', ['at is None', 'a number']),
        (1, '- {at: [1], throw: {}}', ['at is [1]', 'a number']),
        (1, '- {at: 0, throw: {}, at: 1}', ["'at' twice"]),
        (1, '- {at: 0, throw: {speed: 1, speed: 2}}', ["'speed' twice"]),
        # The shape.
        (1, 'at: 0', ['a list of entries like "- {at: 0.0, throw: {}}"']),
        (1, 'throw', ['a list of entries like']),
        (1, '- throw', ['an entry needs a mapping']),
        (1, '- [1, 2]', ['an entry needs a mapping']),
        (1, '- {at: 0, throw: 3}', ['"throw" needs a mapping']),
        (1, '- {at: 0, set: [restitution, 1]}', ['"set" needs a mapping']),
        # Where it is: the line of the value, not of the file or of the entry.
        (3, '# one\n- {at: 0, throw: {}}\n- {at: 0, thorw: {}}', ["no 'thorw'"]),
        (4, '- at: 0\n  throw:\n    speed: 1\n    sped: 2\n', ["no 'sped'"]),
        # Not YAML.
        (2, '- {at: 0, throw: {}}\n- {at: 0]\n', ['this is not YAML']),
        (2, '- {at: 0, throw: {}}\n\t- 3', ['this is not YAML']),
        (1, '- {at: *nothing, throw: {}}', ['this is not YAML']),
        # YAML that has no plain value.
        (1, '- {at: !!python/object/apply:os.getcwd [], throw: {}}', [PLAIN]),
        (1, '- {at: 2001-99-99, throw: {}}', [PLAIN]),
        (1, '- {at: 0, throw: {speed: !mine 3}}', [PLAIN]),
        (1, '- {at: 0, set: {friction: 0x_}}', [PLAIN]),
        (1, '- {at: 0, throw: {spin: [1, 2, &a [*a]]}}', [PLAIN]),
    ],
)  # fmt: skip
def test_an_error_names_file_and_line_and_what_is_allowed(line, text, parts):
    with pytest.raises(ScenarioError) as refused:
        Scenario.parse(text, 'dir/file.yaml')
    message = str(refused.value)
    assert message.startswith(f'dir/file.yaml:{line}: ')
    assert message.endswith('.')
    assert '\n' not in message
    for part in parts:
        assert part in message


def test_two_documents_and_bytes_that_are_no_text_are_not_yaml(tmp_path):
    with pytest.raises(ScenarioError, match='this is not YAML'):
        Scenario.parse('- {at: 0, throw: {}}\n---\n- {at: 1, throw: {}}')
    file = tmp_path / 'noise.yaml'
    file.write_bytes(b'- \xff\xfe\xfa')
    with pytest.raises(ScenarioError, match=r'noise\.yaml: cannot be read as text'):
        Scenario.load(file)
    file.write_bytes(b'- \x00')
    with pytest.raises(ScenarioError, match=r'noise\.yaml.*this is not YAML'):
        Scenario.load(file)


def test_a_missing_file_lists_the_scenarios_that_come_with_the_package(tmp_path):
    with pytest.raises(ScenarioError) as refused:
        Scenario.load(tmp_path / 'none.yaml')
    assert str(refused.value).startswith(f'{tmp_path / "none.yaml"}: there is no such file')
    assert packaged_scenarios()
    for name in packaged_scenarios():
        assert name in str(refused.value)
    with pytest.raises(ScenarioError, match='there is no such file'):
        Scenario.load(tmp_path)


def test_a_scenario_is_loaded_from_a_file_and_named_after_it(tmp_path):
    file = tmp_path / 'mine.yaml'
    file.write_text('- {at: 1, throw: {}}  # é\n', encoding='utf-8')
    scenario = Scenario.load(str(file))
    assert scenario.name == str(file)
    assert [entry.time_ns for entry in scenario.entries] == [10**9]


@pytest.mark.parametrize('name', packaged_scenarios())
def test_every_packaged_scenario_plays_to_its_end_without_a_word(name):
    scenario = Scenario.load(name)
    assert scenario == Scenario.load(packaged_scenarios()[name])
    reports: list[str] = []
    last = scenario.entries[-1].time_ns // 2_000_000
    simulation = Simulation(
        CollectingOutlet(),
        Settings(),
        Throwing(),
        camera=Camera(),
        scenario=scenario,
        end=last + 200,
        report=reports.append,
    )
    while not simulation.finished:
        simulation.advance()
    throws = sum(isinstance(entry.action, Throw) for entry in scenario.entries)
    sent = [entry for entry in simulation.latched() if entry[0] == '~/throws']
    assert throws >= len(sent) == len(simulation.world) > 0
    assert reports == []


def test_the_first_scenario_shows_both_models_of_the_report():
    models = [
        entry.action.values.get('physics_model')
        for entry in Scenario.load('first_throws').entries
        if isinstance(entry.action, Set)
    ]
    assert models == ['simple', 'impulse']
