"""A bag as one HTML file that needs neither server nor network."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np

from cube_sim.web.address import LOOPBACK
from cube_sim.web.playback import Recorded
from cube_sim.web.stage import CameraSign, Stage, serving

# Frames for each second of simulated time; more would make the file larger and show no more.
FRAMES = 30.0


def export(run: Recorded, path: Path) -> int:
    """Write `run` to `path`, which must not exist yet; return the number of frames. OSError."""
    # It would be a pity to fail only after the work.
    with path.open('x', encoding='utf-8') as file, serving(LOOPBACK, 0, 'cube_sim') as server:
        try:
            stage, sign = Stage(server), CameraSign(server.scene)
            if run.ground is not None:
                stage.show_ground(run.ground)
            kept = _thinned(run.times)
            _show(run, kept[0], stage, sign)
            recording = server.get_scene_serializer()
            for before, index in pairwise(kept):
                recording.insert_sleep((run.times[index] - run.times[before]) / 1e9)
                _show(run, index, stage, sign)
            file.write(recording.as_html())
        except BaseException:
            path.unlink()
            raise
    return len(kept)


def _show(run: Recorded, index: int, stage: Stage, sign: CameraSign) -> None:
    time_ns = run.times[index]
    size = run.settings_at(time_ns).get('cube_size', 0.5)
    stage.show_cubes(run.frames[index].astype(np.float64), size)
    camera = run.camera_at(time_ns)
    if camera is not None:
        sign.show(camera)


def _thinned(times: list[int]) -> list[int]:
    """Return the indices of frames that are at least a frame's time apart."""
    kept = [0]
    for index, time_ns in enumerate(times):
        if time_ns - times[kept[-1]] >= 0.999e9 / FRAMES:
            kept.append(index)
    return kept
