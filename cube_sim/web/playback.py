"""Recorded: the frames of a bag, read once and kept."""

from __future__ import annotations

import bisect
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cube_sim.messages.cdr_reader import Data
from cube_sim.messages.decode import (
    MessageError,
    PoseArrayDecoder,
    read_header,
    read_parameter_event,
    read_pose_stamped,
)
from cube_sim.recording import RecordingError
from cube_sim.recording.reader import BagReader

Floats = NDArray[np.float64]

# What the frames may take, bytes; a longer run is shown with fewer frames a second.
BUDGET = 512_000_000
# The most frames for each second of simulated time.
FRAMES = 60.0

_KINDS = {
    'poses': 'geometry_msgs/msg/PoseArray',
    'camera/pose': 'geometry_msgs/msg/PoseStamped',
    'settings': 'rcl_interfaces/msg/ParameterEvent',
    'resets': 'std_msgs/msg/Header',
    'ground': 'visualization_msgs/msg/Marker',
}


@dataclass
class Recorded:
    """A run from a bag. Times are simulated, ns, ascending."""

    path: Path
    times: list[int] = field(default_factory=list)
    frames: list[NDArray[np.float32]] = field(default_factory=list)
    """(N, 7) for each of `times`, m, x y z qx qy qz qw."""
    cameras: list[tuple[int, Floats]] = field(default_factory=list)
    settings: list[tuple[int, dict[str, Any]]] = field(default_factory=list)
    ground: bytes | None = None

    @classmethod
    def read(cls, path: str | Path, simulator: str | None = None) -> Recorded:
        """
        Read the run of `simulator` (such as '/cube_sim'), or the only one that the bag holds.

        RecordingError when there is no bag, no run in it, or something in it is not as it should.
        """
        with BagReader(path) as bag:
            base = _run_in(bag, simulator)
            names = {
                f'{base}/{name}': name
                for name, kind in _KINDS.items()
                if f'{base}/{name}' in bag.topics and bag.topics[f'{base}/{name}'].type == kind
            }
            run = cls(Path(path))
            taking = _Taking(run)
            for message in bag.messages(names):
                try:
                    taking.take(names[message.topic], message.data)
                except MessageError as error:
                    raise RecordingError(f'{path}: {message.topic}: {error}') from None
        if not run.times:
            raise RecordingError(f'{path} holds no poses of {base} to show.')
        return run

    def index_at(self, time_ns: int) -> int:
        """Return the frame that is shown at a time: the last one until then."""
        return max(0, bisect.bisect_right(self.times, time_ns) - 1)

    def camera_at(self, time_ns: int) -> Floats | None:
        """Return where the camera is then."""
        at = bisect.bisect_right(self.cameras, time_ns, key=lambda entry: entry[0])
        return self.cameras[at - 1][1] if at else None

    def settings_at(self, time_ns: int) -> dict[str, Any]:
        """Return the physics settings that hold then, by their parameters' names."""
        at = bisect.bisect_right(self.settings, time_ns, key=lambda entry: entry[0])
        return self.settings[at - 1][1] if at else {}


class _Taking:
    """Takes the messages of a bag into a run; thins the frames out when they grow too many."""

    def __init__(self, run: Recorded) -> None:
        self._run = run
        self._decode = PoseArrayDecoder()
        self._period_ns = round(1e9 / FRAMES)
        self._bytes = 0

    def take(self, name: str, data: Data) -> None:
        run = self._run
        if name == 'poses':
            view = self._decode(data)
            self._frame(view.time_ns, view.poses.astype(np.float32))
        elif name == 'camera/pose':
            camera = read_pose_stamped(data)
            run.cameras.append((camera.time_ns, np.array(camera.pose)))
        elif name == 'settings':
            event = read_parameter_event(data)
            before = run.settings[-1][1] if run.settings else {}
            run.settings.append((event.time_ns, {**before, **event.new, **event.changed}))
        elif name == 'resets':
            self._frame(read_header(data)[0], np.empty((0, 7), np.float32))
        elif name == 'ground' and run.ground is None:
            run.ground = bytes(data)

    def _frame(self, time_ns: int, poses: NDArray[np.float32]) -> None:
        run = self._run
        last = run.times[-1] if run.times else None
        # A throw or a reset shows at once, whatever the rate.
        if last is not None and len(run.frames[-1]) == len(poses):
            if time_ns - last < self._period_ns:
                return
        elif last is not None and time_ns < last:
            return
        run.times.append(time_ns)
        run.frames.append(poses)
        self._bytes += poses.nbytes
        if self._bytes > BUDGET:
            self._thin()

    def _thin(self) -> None:
        run = self._run
        self._period_ns *= 2
        run.times = run.times[::2]
        run.frames = run.frames[::2]
        self._bytes = sum(frame.nbytes for frame in run.frames)


def _run_in(bag: BagReader, simulator: str | None) -> str:
    kind = _KINDS['poses']
    bases = [
        name.removesuffix('/poses')
        for name, topic in bag.topics.items()
        if name.endswith('/poses') and topic.type == kind
    ]
    if simulator is not None and (simulator in bases or len(bases) != 1):
        bases = [base for base in bases if base == simulator] or bases
    if len(bases) == 1:
        return bases[0]
    known = ', '.join(bases) or 'none'
    raise RecordingError(
        f'{bag.path}: one run with a topic …/poses is needed, there are: {known}. Choose with '
        '--simulator.'
    )
