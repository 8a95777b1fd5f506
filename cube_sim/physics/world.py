"""The cubes of a run and the time: what other rooms hold in their hands."""

from __future__ import annotations

import hashlib
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cube_sim.physics import step as layout
from cube_sim.physics.engine import ContactPoints, Engine
from cube_sim.physics.models import model_named
from cube_sim.physics.refusal import PhysicsError
from cube_sim.physics.settings import Settings

Floats = NDArray[np.float64]

# What a throw may ask for. Beyond these the numbers still compute, but no longer mean anything:
# at 1e7 m a float64 resolves 2 nm, and the angle of a step can no longer be reduced exactly.
POSITION_LIMIT = 1e7
VELOCITY_LIMIT = 1e5
SPIN_LIMIT = 1e5


class World:
    """
    Cubes above the plane z = 0, all of one side, 1 kg each, advanced in fixed steps.

    The same throws, settings and number of steps give the same bits on every machine, for any
    number of `threads` and any batching of the steps.
    """

    def __init__(self, settings: Settings | None = None, *, threads: int = 1) -> None:
        """Make an empty world at time 0; `threads` compute together once there are many cubes."""
        if type(threads) is not int or threads < 1:
            raise PhysicsError(f'threads is {threads!r}: a whole number from 1 on is needed.')
        self._threads = threads
        self._count = 0
        self._steps = 0
        self._contacts = 0
        self._state = np.zeros((layout.ROWS, 16))
        self._poses = _Interleaved(layout.PX, 7)
        self._velocities = _Interleaved(layout.VX, 6)
        settings = settings if settings is not None else Settings()
        self._adopt(settings, self._engine_for(settings))

    def __len__(self) -> int:
        """Return the number of cubes."""
        return self._count

    @property
    def settings(self) -> Settings:
        """The settings that hold for the next step."""
        return self._settings

    @property
    def steps(self) -> int:
        """The number of steps taken since the world was made."""
        return self._steps

    @property
    def time_ns(self) -> int:
        """The simulated time, ns: steps times the length of one."""
        return self._steps * self._settings.time_step_ns

    @property
    def contacts(self) -> int:
        """
        How many contacts there have been so far, counted in each step.

        A cube that touches the plane is one; under `contact` also a pair that touches, and a cube
        that rests, whatever it rests on.
        """
        return self._contacts

    @property
    def awake(self) -> int:
        """The number of cubes that are not asleep; all, in a model that knows no sleep."""
        return self._engine.awake(self._count)

    @property
    def contact_points(self) -> ContactPoints:
        """Where cubes touched in the last step; none in a model that keeps no contacts."""
        return self._engine.contact_points(self._count)

    @property
    def counters(self) -> dict[str, int]:
        """What the last step of the model took, by name; nothing where it does not vary."""
        return self._engine.counters()

    @property
    def poses(self) -> Floats:
        """Poses (N, 7) in throw order, x y z qx qy qz qw, m, world: a read-only view."""
        return self._poses.of(self._state, self._count)

    @property
    def velocities(self) -> Floats:
        """Velocities (N, 6), vx vy vz wx wy wz, m/s and rad/s, world: a read-only view."""
        return self._velocities.of(self._state, self._count)

    def throw(
        self,
        position: ArrayLike,
        orientation: ArrayLike,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        spin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> int:
        """
        Add one cube, or N at once, and return the index of the first.

        `position` (3,) or (N, 3), m; `orientation` (4,) or (N, 4), x y z w, normalised when it
        merely is not of unit length; `velocity` (3,) or (N, 3), m/s; `spin` (3,) or (N, 3),
        rad/s; all in world. One row serves all N. Anything not finite, out of range or of
        another shape raises PhysicsError and adds nothing.
        """
        columns = [
            vectors('position', position, 3, POSITION_LIMIT, 'm'),
            unit_quaternions(orientation),
            vectors('velocity', velocity, 3, VELOCITY_LIMIT, 'm/s'),
            vectors('spin', spin, 3, SPIN_LIMIT, 'rad/s'),
        ]
        added = max(len(column) for column in columns)
        if any(len(column) not in (1, added) for column in columns):
            raise PhysicsError(
                'A throw needs as many rows everywhere, or one for all; it has '
                f'{", ".join(str(len(column)) for column in columns)} '
                'of position, orientation, velocity, spin.'
            )
        first = self._count
        self._reserve(first + added)
        row = 0
        for column in columns:
            self._state[row : row + column.shape[1], first : first + added] = column.T
            row += column.shape[1]
        self._count += added
        self._engine.added(first, self._count)
        self._changed()
        return first

    def step(self, steps: int = 1) -> None:
        """Advance by that many fixed steps."""
        if not isinstance(steps, (int, np.integer)) or steps < 0:
            raise PhysicsError(f'steps is {steps!r}: a whole number from 0 on is needed.')
        steps = int(steps)
        if self._count:
            self._contacts += self._engine.advance(self._count, steps)
            self._changed()
        self._steps += steps

    def configure(self, **changes: Any) -> None:
        """
        Change settings from the next step on.

        PhysicsError names a value that cannot be, and then nothing is changed. The length of
        a step belongs to the run: it cannot change.
        """
        settings = self._settings.changed(**changes)
        if settings.time_step_ns != self._settings.time_step_ns:
            raise PhysicsError('time_step_ns is fixed for a run: make another World to change it.')
        if settings == self._settings:
            return
        same_model = settings.model == self._settings.model
        # A model that cannot be made ready (PhysicsError) leaves the world as it is.
        self._adopt(settings, self._engine if same_model else self._engine_for(settings))

    def reset(self) -> None:
        """Remove every cube; time goes on."""
        self._count = 0
        self._engine.cleared()
        self._changed()

    def digest(self) -> str:
        """Return the SHA-256 of time and state: equal digests are equal to the bit."""
        content = hashlib.sha256(np.int64(self._steps).tobytes())
        content.update(np.ascontiguousarray(self._state[:, : self._count]).tobytes())
        return content.hexdigest()

    def _adopt(self, settings: Settings, engine: Engine) -> None:
        self._settings = settings
        self._engine = engine
        engine.use(self._state, settings)

    def _engine_for(self, settings: Settings) -> Engine:
        engine = model_named(settings.model).engine(self._threads)
        engine.added(0, self._count)
        return engine

    def _reserve(self, count: int) -> None:
        if count > self._state.shape[1]:
            state = np.zeros((layout.ROWS, max(count, 2 * self._state.shape[1])))
            state[:, : self._count] = self._state[:, : self._count]
            self._state = state
            self._engine.use(state, self._settings)

    def _changed(self) -> None:
        self._poses.stale = True
        self._velocities.stale = True


class _Interleaved:
    """Some rows of the state as one read-only array, a row for each cube, made when asked for."""

    def __init__(self, first_row: int, columns: int) -> None:
        self.stale = True
        self._first_row = first_row
        self._memory: Floats = np.empty((0, columns))
        self._view: Floats = self._memory

    def of(self, state: Floats, count: int) -> Floats:
        if self.stale:
            if count > len(self._memory):
                self._memory = np.empty((state.shape[1], self._memory.shape[1]))
            rows = slice(self._first_row, self._first_row + self._memory.shape[1])
            self._memory[:count] = state[rows, :count].T
            self._view = self._memory[:count]
            self._view.flags.writeable = False
            self.stale = False
        return self._view


def unit_quaternions(orientation: ArrayLike, name: str = 'orientation') -> Floats:
    """
    Return orientations (N, 4), x y z w, of unit length; PhysicsError when one has no direction.

    One that is of unit length to rounding keeps its bits, so that an orientation that was
    recorded and read back is the very one that was used.
    """
    quaternions = vectors(name, orientation, 4, 1e100, '')
    square = np.sum(quaternions * quaternions, axis=1, keepdims=True)
    if not np.all(square > 1e-12):
        raise PhysicsError(f'{name} is zero: a quaternion x, y, z, w of unit length is needed.')
    off = np.abs(square[:, 0] - 1.0) > 4e-15
    if np.any(off):
        quaternions = quaternions.copy()
        quaternions[off] /= np.sqrt(square[off])
    return quaternions


def turned_by(orientation: ArrayLike, vector: ArrayLike) -> Floats:
    """
    Return `vector` (3,) turned by the unit quaternion `orientation` (4,), x y z w.

    v + 2 u x (u x v + w v), one rounded operation after the other: the same bits everywhere.
    """
    x, y, z, w = np.asarray(orientation, np.float64)
    ax, ay, az = np.asarray(vector, np.float64)
    cx = (y * az - z * ay) + w * ax
    cy = (z * ax - x * az) + w * ay
    cz = (x * ay - y * ax) + w * az
    return np.array(
        [
            ax + 2.0 * (y * cz - z * cy),
            ay + 2.0 * (z * cx - x * cz),
            az + 2.0 * (x * cy - y * cx),
        ]
    )


def vectors(name: str, values: ArrayLike, columns: int, limit: float, unit: str) -> Floats:
    """
    Return `values` (columns,) or (N, columns) as rows (N, columns).

    PhysicsError, with `name`, for another shape or a number that is not finite or beyond `limit`.
    """
    try:
        rows = np.atleast_2d(np.asarray(values, np.float64))
    except (TypeError, ValueError):
        raise PhysicsError(f'{name} is {values!r}: numbers are needed.') from None
    if rows.ndim != 2 or rows.shape[1] != columns:
        raise PhysicsError(
            f'{name} has shape {np.shape(values)}: ({columns},) or (N, {columns}) is needed.'
        )
    bad = ~(np.abs(rows) <= limit)
    if bad.any():
        value = float(rows[bad][0])
        if math.isfinite(value):
            raise PhysicsError(f'{name} has {value:g}: at most {limit:g} {unit} is meaningful.')
        raise PhysicsError(f'{name} has {value}: finite numbers are needed.')
    return rows
