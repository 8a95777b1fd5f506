"""A recorded run simulated again: the same throws, settings and resets at the same steps."""

from __future__ import annotations

from collections.abc import Callable

from cube_sim.analysis.timeline import Configured, Moment, Removed, Thrown
from cube_sim.physics import Settings, World
from cube_sim.recording import RecordingError


class Replay:
    """
    A world that is taken through the moments of a timeline.

    Before each moment the world is stepped to its time, so that after `take` of a `Posed` it is
    in the state that was recorded. With `on_step` it goes one step at a time and calls after
    each; without, as many at once as it can.
    """

    def __init__(self, on_step: Callable[[World, int], None] | None = None) -> None:
        """Begin before the first moment; `on_step` gets the world and its simulated time, ns."""
        self._on_step = on_step
        self._start_ns = 0
        self._world: World | None = None

    @property
    def world(self) -> World:
        """The world; RecordingError before the first settings."""
        if self._world is None:
            raise RecordingError('The recording has no settings before its first throw or poses.')
        return self._world

    @property
    def time_ns(self) -> int:
        """The simulated time that the world is at, ns."""
        return self._start_ns + (self._world.time_ns if self._world is not None else 0)

    def take(self, moment: Moment) -> None:
        """Go to the time of `moment` and do what happened there."""
        if self._world is None and isinstance(moment, Configured):
            self._world = World(moment.settings)
            self._start_ns = moment.time_ns
            return
        self._go_to(moment.time_ns)
        if isinstance(moment, Configured):
            self._configure(moment.settings)
        elif isinstance(moment, Removed):
            self.world.reset()
        elif isinstance(moment, Thrown):
            pose, velocity = moment.pose, moment.velocity
            index = self.world.throw(pose[:3], pose[3:], velocity[:3], velocity[3:])
            if index != moment.index:
                raise RecordingError(
                    f'cube_{moment.index} is thrown at {moment.time_ns / 1e9:.3f} s, but the '
                    f'recording holds only {index} throws before it: some were not recorded.'
                )

    def _go_to(self, time_ns: int) -> None:
        world = self.world
        steps, rest = divmod(time_ns - self.time_ns, world.settings.time_step_ns)
        if rest or steps < 0:
            raise RecordingError(
                f'{time_ns} ns is no whole number of steps after {self.time_ns} ns: '
                'the messages are not in order, or not of one run.'
            )
        if self._on_step is None:
            world.step(steps)
            return
        for _ in range(steps):
            world.step()
            self._on_step(world, self.time_ns)

    def _configure(self, settings: Settings) -> None:
        self.world.configure(
            **{name: getattr(settings, name) for name in settings.__dataclass_fields__}
        )
