"""The pace: a thread that runs a simulation against a steady clock, and takes commands."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future
from dataclasses import dataclass
from typing import Any, TypeVar

from cube_sim.physics import PhysicsError
from cube_sim.simulation.simulation import Simulation

Result = TypeVar('Result')

# How far the simulation may be behind the clock and still catch up, s of wall time. What is
# lost beyond that is given up: it shows as overruns and as a real-time factor that is not met.
CATCH_UP = 0.25


@dataclass(frozen=True)
class Progress:
    """Counters since the start; the difference of two tells how it went in between."""

    wall_ns: int
    sim_ns: int
    steps: int
    physics_ns: int
    messages_ns: int
    overruns: int
    lost_ns: int


class Runner:
    """
    Runs a simulation in a thread of its own, the only one that touches it.

    A batch of steps is due when the clock has reached its end. One that ends late is an
    overrun; lateness beyond `CATCH_UP` is given up and counted too, never made up by larger
    steps.
    """

    def __init__(
        self,
        simulation: Simulation,
        *,
        real_time_factor: float = 1.0,
        paused: bool = False,
        on_finished: Callable[[], None] = lambda: None,
    ) -> None:
        """Set up; `start` runs it. A factor of 0 runs as fast as it can."""
        self._simulation = simulation
        self._real_time_factor = real_time_factor
        self._paused = paused
        self._on_finished = on_finished
        self._velocity: tuple[list[float], list[float], float] | None = None
        self._commands: deque[tuple[Callable[[], Any], Future[Any]]] = deque()
        self._wake = threading.Condition()
        self._stopping = False
        self._overruns = 0
        self._lost_ns = 0
        self._anchor = (0, 0)
        self._flown = 0.0
        self._thread = threading.Thread(target=self._run, name='simulation', daemon=True)

    @property
    def paused(self) -> bool:
        """Whether time stands still."""
        return self._paused

    @property
    def real_time_factor(self) -> float:
        """Simulated seconds for each second of the clock, as asked for; 0 is no limit."""
        return self._real_time_factor

    def start(self) -> None:
        """Begin to run."""
        self._thread.start()

    def stop(self) -> None:
        """Stop between two batches and wait for it; commands not yet taken raise RuntimeError."""
        with self._wake:
            self._stopping = True
            self._wake.notify()
        if self._thread.is_alive() and threading.current_thread() is not self._thread:
            self._thread.join()
        self._refuse_commands()

    def do(self, command: Callable[[], Result]) -> Result:
        """
        Run `command` between two steps, in the simulation's thread; return what it returns.

        What it raises is raised here. RuntimeError when the simulation has stopped.
        """
        if self._thread.ident is None or threading.current_thread() is self._thread:
            return command()
        future: Future[Result] = Future()
        with self._wake:
            if self._stopping:
                raise _stopped()
            self._commands.append((command, future))
            self._wake.notify()
        return future.result()

    def pause(self, paused: bool) -> None:
        """Stop or continue time. For use in a command."""
        self._paused = paused
        self._set_anchor()

    def set_real_time_factor(self, factor: float) -> None:
        """Pace by `factor` from now on. For use in a command."""
        self._real_time_factor = factor
        self._set_anchor()

    def fly(self, linear: list[float], angular: list[float], seconds: float) -> None:
        """Move the camera at that velocity, m/s and rad/s, for that long. For use in a command."""
        now = time.monotonic()
        # The former velocity has held until now: commands may come faster than frames.
        self._fly_camera(now)
        moving = any(linear) or any(angular)
        self._velocity = (linear, angular, now + seconds) if moving else None
        self._flown = now

    def progress(self) -> Progress:
        """Return the counters as they are."""
        simulation = self._simulation
        return Progress(
            wall_ns=time.monotonic_ns(),
            sim_ns=simulation.world.time_ns,
            steps=simulation.world.steps,
            physics_ns=simulation.physics_ns,
            messages_ns=simulation.messages_ns,
            overruns=self._overruns,
            lost_ns=self._lost_ns,
        )

    def _run(self) -> None:
        try:
            self._pace()
        finally:
            # After an error, too: nobody shall wait for an answer that cannot come.
            with self._wake:
                self._stopping = True
            self._refuse_commands()

    def _pace(self) -> None:
        self._set_anchor()
        while not self._stopping:
            self._take_commands()
            self._fly_camera(time.monotonic())
            if self._simulation.finished:
                self._on_finished()
                self._wait(None)
            elif self._paused:
                self._wait(None)
            elif self._real_time_factor == 0.0:
                self._simulation.advance()
            else:
                early_ns = self._due_ns() - time.monotonic_ns()
                if early_ns > 0:
                    self._wait(early_ns * 1e-9)
                else:
                    self._simulation.advance()
                    self._count_lateness()

    def _take_commands(self) -> None:
        while self._commands:
            command, future = self._commands.popleft()
            try:
                future.set_result(command())
            except Exception as error:  # it belongs to whoever gave the command
                future.set_exception(error)

    def _refuse_commands(self) -> None:
        while self._commands:
            self._commands.popleft()[1].set_exception(_stopped())

    def _wait(self, seconds: float | None) -> None:
        """Wait for that time, for ever if None, but no longer than until a command comes."""
        if self._velocity is not None:
            # The camera flies on, whether time stands still or not.
            frame = 0.02
            seconds = frame if seconds is None else min(seconds, frame)
        with self._wake:
            if not self._commands and not self._stopping:
                self._wake.wait(seconds)

    def _fly_camera(self, now: float) -> None:
        if self._velocity is None:
            return
        linear, angular, until = self._velocity
        now = min(now, until)
        if now > self._flown:
            try:
                self._simulation.fly_camera(linear, angular, now - self._flown)
            except PhysicsError:  # it is as far away as it may be, and stays there
                until = now
            self._flown = now
        if now == until:
            self._velocity = None

    def _set_anchor(self) -> None:
        self._anchor = (time.monotonic_ns(), self._simulation.world.time_ns)

    def _due_ns(self) -> int:
        """Return the clock's reading at which the next batch is due."""
        wall_ns, sim_ns = self._anchor
        ahead_ns = self._simulation.next_publication_ns - sim_ns
        return wall_ns + round(ahead_ns / self._real_time_factor)

    def _count_lateness(self) -> None:
        """Note a batch that ended after the next was due, and give up what is too much."""
        late_ns = time.monotonic_ns() - self._due_ns()
        if late_ns <= 0:
            return
        self._overruns += 1
        if late_ns > CATCH_UP * 1e9:
            wall_ns, sim_ns = self._anchor
            self._anchor = (wall_ns + late_ns, sim_ns)
            self._lost_ns += late_ns


def _stopped() -> RuntimeError:
    return RuntimeError('The simulation has stopped.')
