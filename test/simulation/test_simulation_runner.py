"""The runner: its thread, its commands, and its pace on a clock that the tests turn."""

from __future__ import annotations

import threading
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest
from support.collecting_outlet import CollectingOutlet

from cube_sim.physics import PhysicsError, Settings, World
from cube_sim.simulation import Scenario, Simulation, Throwing
from cube_sim.simulation.camera import Camera
from cube_sim.simulation.runner import CATCH_UP, Runner

MS = 1_000_000
PERIOD = 20 * MS


class Clock:
    """Stands for the module `time`: it stands still until someone turns it."""

    def __init__(self) -> None:
        self.now_ns = 1_000 * MS

    def monotonic_ns(self) -> int:
        return self.now_ns

    def monotonic(self) -> float:
        return self.now_ns / 1e9


class Bell(threading.Condition):
    """A condition on which waiting for a time takes that time on a `Clock`, and no other."""

    def __init__(self, clock: Clock) -> None:
        super().__init__()
        self._clock = clock
        self.rung = threading.Semaphore(0)

    def wait(self, timeout: float | None = None) -> bool:
        if timeout is None:
            return super().wait()
        self._clock.now_ns += max(1, round(timeout * 1e9))
        return False

    def notify(self, n: int = 1) -> None:
        super().notify(n)
        self.rung.release()


@pytest.fixture
def clock(monkeypatch) -> Clock:
    clock = Clock()
    module = 'cube_sim.simulation.runner.time'
    monkeypatch.setattr(module, clock)
    return clock


@pytest.fixture
def made(clock):
    """Make runners; those that are left running at the end are stopped."""
    runners = []

    def make(scenario: str = '', end: int | None = None, **options) -> SimpleNamespace:
        outlet = CollectingOutlet()
        simulation = Simulation(
            outlet,
            Settings(),
            Throwing(),
            camera=Camera(),
            scenario=Scenario.parse(scenario),
            end=end,
        )
        runner = Runner(simulation, **options)
        bell = Bell(clock)
        runner._wake = bell
        runners.append(runner)
        return SimpleNamespace(outlet=outlet, simulation=simulation, runner=runner, bell=bell)

    yield make
    for runner in runners:
        runner.stop()


def on_poses(outlet: CollectingOutlet, act) -> None:
    """Call `act(n)` in the simulation's thread when the n-th poses are sent, n from 1 on."""
    outlet.on_send = lambda topic, time_ns: act(time_ns // PERIOD) if topic == '~/poses' else None


def test_a_batch_is_published_when_the_clock_has_reached_its_end(clock, made):
    # On the fake clock nothing costs time: publication n comes at n times 20 ms of simulated time
    # divided by the factor, to the nanosecond that a wait is rounded to.
    for factor in (1.0, 0.5, 4.0):
        one = made(real_time_factor=factor)
        start = clock.now_ns
        came: list[int] = []
        on_poses(one.outlet, lambda n, came=came: came.append(clock.now_ns))
        one.runner.start()
        one.outlet.wait_for('~/poses', 50)
        one.runner.stop()
        due = start + np.arange(1, 51) * PERIOD / factor
        assert np.abs(np.array(came[:50]) - due).max() <= 1
        assert one.runner.progress().overruns == one.runner.progress().lost_ns == 0


def test_lateness_is_caught_up_and_counted_and_never_makes_steps_larger(clock, made):
    # The fifth publication takes 100 ms. It ends at 200 ms instead of 100; those due at 120, 140,
    # 160, 180 and 200 ms follow at once: late after batches 5, 6, 7 and 8; batch 9 ends at 200 ms,
    # when 10 is due and not late; from 11 on all is as if nothing had been.
    one = made(scenario='- {at: 0, throw: {}}')
    start = clock.now_ns
    came = {}

    def act(n: int) -> None:
        came[n] = clock.now_ns - start
        if n == 5:
            clock.now_ns += 100 * MS

    on_poses(one.outlet, act)
    one.runner.start()
    one.outlet.wait_for('~/poses', 20)
    one.runner.stop()
    expected = {n: n * PERIOD for n in range(1, 6)}
    expected |= dict.fromkeys(range(6, 11), 200 * MS)
    expected |= {n: n * PERIOD for n in range(11, 21)}
    assert {n: came[n] for n in expected} == pytest.approx(expected, abs=1)
    progress = one.runner.progress()
    assert progress.overruns == 4
    assert progress.lost_ns == 0

    stamps = [time_ns for time_ns, _ in one.outlet.of('~/poses')]
    assert stamps == [n * PERIOD for n in range(1, len(stamps) + 1)]
    twin = World(Settings())
    twin.throw((0, 0, 1.5), (0, 0, 0, 1), (8, 0, 0), (1, 2, 3))
    twin.step(progress.steps)
    assert one.simulation.world.digest() == twin.digest()


def test_lateness_beyond_what_can_be_caught_up_is_given_up_and_counted(clock, made):
    # The third publication takes 1 s: it ends at 1060 ms, when the fourth was due at 80. More than
    # CATCH_UP is behind, so that all 980 ms are lost, and the fourth is due at once.
    one = made()
    assert CATCH_UP < 0.98
    start = clock.now_ns
    came = {}

    def act(n: int) -> None:
        came[n] = clock.now_ns - start
        if n == 3:
            clock.now_ns += 1_000 * MS

    on_poses(one.outlet, act)
    one.runner.start()
    one.outlet.wait_for('~/poses', 10)
    one.runner.stop()
    expected = {n: n * PERIOD for n in range(1, 4)}
    expected |= {n: n * PERIOD + 980 * MS for n in range(4, 11)}
    assert {n: came[n] for n in expected} == pytest.approx(expected, abs=1)
    progress = one.runner.progress()
    assert progress.overruns == 1
    assert progress.lost_ns == pytest.approx(980 * MS, abs=1)
    assert progress.steps * 2 * MS == progress.sim_ns == len(one.outlet.of('~/poses')) * PERIOD


def test_a_new_factor_holds_from_now_on(clock, made):
    one = made(real_time_factor=1.0)
    start = clock.now_ns
    came = {}

    def act(n: int) -> None:
        came[n] = clock.now_ns - start
        if n == 5:
            one.runner.set_real_time_factor(2.0)

    on_poses(one.outlet, act)
    one.runner.start()
    one.outlet.wait_for('~/poses', 9)
    one.runner.stop()
    assert one.runner.real_time_factor == 2.0
    assert came[5] == pytest.approx(100 * MS, abs=1)
    # Set within the fifth batch, whose end is not yet due by it: 10 ms each from there.
    assert came[9] == pytest.approx(140 * MS, abs=2)


def test_as_fast_as_it_can_waits_for_no_clock(clock, made):
    one = made(real_time_factor=0.0, end=5000)
    now = clock.now_ns
    one.runner.start()
    one.outlet.wait_for('~/poses', 500)
    assert one.runner.do(lambda: one.simulation.finished)
    assert clock.now_ns == now
    assert one.runner.progress().overruns == 0


def test_commands_run_in_the_simulation_s_thread_between_batches(made):
    one = made(real_time_factor=0.0)
    one.runner.start()
    for _ in range(50):
        thread, steps, next_ns = one.runner.do(
            lambda: (
                threading.current_thread().name,
                one.simulation.world.steps,
                one.simulation.next_publication_ns,
            )
        )
        assert thread == 'simulation'
        assert steps % 10 == 0
        assert next_ns == (steps + 10) * 2 * MS


def test_a_command_may_give_commands(made):
    one = made(real_time_factor=0.0)
    one.runner.start()
    assert one.runner.do(lambda: one.runner.do(lambda: 7)) == 7


def test_before_the_start_a_command_runs_at_once(made):
    one = made()
    assert one.runner.do(threading.current_thread) is threading.current_thread()


def test_what_a_command_raises_is_raised_where_it_was_given_and_the_run_goes_on(made):
    one = made(real_time_factor=0.0)
    one.runner.start()
    with pytest.raises(PhysicsError, match='restitution is 3'):
        one.runner.do(lambda: one.simulation.configure({'restitution': 3}))
    assert one.runner.do(one.simulation.throw) == 0
    one.outlet.wait_for('~/poses', len(one.outlet.of('~/poses')) + 2)


def test_many_threads_may_give_commands_and_each_gets_its_answer(made):
    one = made(real_time_factor=0.0)
    one.runner.start()
    with ThreadPoolExecutor(8) as pool:
        answers = list(pool.map(lambda n: one.runner.do(lambda: n), range(200)))
        throws = list(pool.map(lambda _: one.runner.do(one.simulation.throw), range(200)))
    assert answers == list(range(200))
    assert sorted(throws) == list(range(200))


def test_a_pause_stops_time_until_it_is_continued(clock, made):
    one = made(real_time_factor=0.0)
    one.runner.start()
    one.outlet.wait_for('~/poses', 3)
    one.runner.do(lambda: one.runner.pause(True))
    assert one.runner.paused
    steps = one.runner.do(lambda: one.simulation.world.steps)
    for _ in range(20):
        assert one.runner.do(lambda: one.simulation.world.steps) == steps
    one.runner.do(one.simulation.advance)
    assert one.runner.do(lambda: one.simulation.world.steps) == steps + 10
    published = len(one.outlet.of('~/poses'))
    one.runner.do(lambda: one.runner.pause(False))
    assert not one.runner.paused
    one.outlet.wait_for('~/poses', published + 5)


def test_time_that_passes_in_a_pause_is_not_made_up_for(clock, made):
    one = made(paused=True)
    came = {}
    on_poses(one.outlet, lambda n: came.setdefault(n, clock.now_ns))
    one.runner.start()
    assert one.runner.do(lambda: one.simulation.world.steps) == 0

    def resume() -> int:
        clock.now_ns += 60_000 * MS
        one.runner.pause(False)
        return clock.now_ns

    resumed = one.runner.do(resume)
    one.outlet.wait_for('~/poses', 5)
    one.runner.stop()
    assert [came[n] - resumed for n in range(1, 6)] == pytest.approx(
        [n * PERIOD for n in range(1, 6)], abs=1
    )
    assert one.runner.progress().overruns == 0


def test_the_end_of_a_run_is_told_after_its_last_step(made):
    finished = threading.Event()
    one = made(real_time_factor=0.0, end=123, on_finished=finished.set)
    one.runner.start()
    assert finished.wait(20.0)
    assert one.simulation.world.steps == 123
    # Commands are still taken, and time has ended.
    assert one.runner.do(one.simulation.throw) == 0
    assert one.runner.do(lambda: one.simulation.world.steps) == 123
    one.runner.stop()


def test_after_a_stop_no_command_is_taken_and_no_step_made(made):
    one = made(real_time_factor=0.0)
    one.runner.start()
    one.outlet.wait_for('~/poses', 2)
    one.runner.stop()
    steps = one.simulation.world.steps
    called = []
    with pytest.raises(RuntimeError, match='The simulation has stopped'):
        one.runner.do(lambda: called.append(1))
    assert called == []
    assert one.simulation.world.steps == steps
    one.runner.stop()


def test_a_stop_wakes_a_paused_run(made):
    one = made(paused=True)
    one.runner.start()
    one.runner.do(lambda: None)
    one.runner.stop()
    assert one.simulation.world.steps == 0


def test_a_command_that_waits_when_the_run_stops_gets_an_error(made):
    # The run is held within a publication; then a command comes, then the stop; then it goes on.
    one = made(real_time_factor=0.0)
    held, go_on = threading.Event(), threading.Event()

    def hold(n: int) -> None:
        held.set()
        assert go_on.wait(20.0)

    on_poses(one.outlet, hold)
    one.runner.start()
    assert held.wait(20.0)
    called = []
    with ThreadPoolExecutor(2) as pool:
        command = pool.submit(one.runner.do, lambda: called.append(1))
        assert one.bell.rung.acquire(timeout=20.0)
        stop = pool.submit(one.runner.stop)
        assert one.bell.rung.acquire(timeout=20.0)
        go_on.set()
        assert stop.result(20.0) is None
        with pytest.raises(RuntimeError, match='The simulation has stopped'):
            command.result(20.0)
    assert called == []


def test_a_run_that_breaks_leaves_nobody_waiting(made, monkeypatch):
    # An outlet that fails ends the thread: a command that waits then, and one that comes later,
    # must hear of it.
    one = made(real_time_factor=0.0)
    broken = []
    monkeypatch.setattr(threading, 'excepthook', lambda arguments: broken.append(arguments))
    held, go_on = threading.Event(), threading.Event()

    def fail(n: int) -> None:
        held.set()
        assert go_on.wait(20.0)
        raise OSError('the outlet is broken')

    on_poses(one.outlet, fail)
    one.runner.start()
    assert held.wait(20.0)
    with ThreadPoolExecutor(1) as pool:
        command = pool.submit(one.runner.do, lambda: 1)
        assert one.bell.rung.acquire(timeout=20.0)
        go_on.set()
        with pytest.raises(RuntimeError, match='The simulation has stopped'):
            command.result(20.0)
    with pytest.raises(RuntimeError, match='The simulation has stopped'):
        one.runner.do(lambda: 1)
    one.runner.stop()
    assert [str(arguments.exc_value) for arguments in broken] == ['the outlet is broken']


def test_the_camera_flies_for_its_time_and_no_longer_also_in_a_pause(clock, made):
    # 0.51 s at 2 m/s are 1.02 m, though a frame lasts 20 ms; the sum of the parts rounds.
    one = made(paused=True)
    one.runner.start()
    arrived = threading.Event()

    def watch(topic: str, _: int) -> None:
        if topic == '~/camera/pose' and abs(one.simulation.camera.position[0] - 1.02) < 1e-9:
            arrived.set()

    one.outlet.on_send = watch
    one.runner.do(lambda: one.runner.fly([2.0, 0.0, 0.0], [0.0, 0.0, 0.0], 0.51))
    assert arrived.wait(20.0)
    sent = len(one.outlet.of('~/camera/pose'))
    assert sent > 10

    def later() -> None:
        clock.now_ns += 5_000 * MS

    one.runner.do(later)
    one.runner.do(lambda: None)
    assert len(one.outlet.of('~/camera/pose')) == sent
    np.testing.assert_allclose(one.simulation.camera.position, (1.02, 0, 1.5), atol=1e-12)
    assert one.simulation.world.steps == 0


def test_a_velocity_of_zero_stops_the_camera(clock, made):
    one = made(paused=True)
    one.runner.start()

    def start_and_stop() -> None:
        one.runner.fly([1.0, 0.0, 0.0], [0.0, 0.0, 0.0], 3600.0)
        one.runner.fly([0.0, 0.0, 0.0], [0.0, 0.0, 0.0], 3600.0)
        clock.now_ns += 1_000 * MS

    one.runner.do(start_and_stop)
    one.runner.do(lambda: None)
    assert one.simulation.camera.position.tolist() == [0, 0, 1.5]


def test_a_camera_that_flies_out_of_the_world_stops_there_and_the_run_goes_on(clock, made):
    one = made(real_time_factor=0.0)
    one.runner.start()

    def fly_away() -> None:
        one.runner.fly([1e5, 0.0, 0.0], [0.0, 0.0, 0.0], 1e6)
        clock.now_ns += 1_000_000 * MS

    one.runner.do(fly_away)
    published = len(one.outlet.of('~/poses'))
    one.outlet.wait_for('~/poses', published + 3)
    assert one.runner.do(lambda: one.simulation.camera.position.tolist()) == [0, 0, 1.5]


def test_progress_counts_steps_time_and_cost(clock, made):
    one = made(real_time_factor=0.0, end=200)
    before = one.runner.progress()
    one.runner.start()
    one.outlet.wait_for('~/poses', 20)
    one.runner.do(lambda: None)
    after = one.runner.progress()
    assert (before.steps, before.sim_ns) == (0, 0)
    assert (after.steps, after.sim_ns) == (200, 400 * MS)
    assert after.physics_ns > before.physics_ns == 0
    assert after.messages_ns > before.messages_ns == 0
    assert after.wall_ns == clock.now_ns
