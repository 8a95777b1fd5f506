"""Player: a bag on pages, with a time slider."""

from __future__ import annotations

import threading
import time
from typing import Any

import numpy as np
import viser

from cube_sim.web.heights import CUBES, SPAN, beside
from cube_sim.web.playback import Recorded
from cube_sim.web.stage import CameraSign, Stage

_SPEEDS = ('0.1', '0.25', '0.5', '1', '2', '4', '8')
_PERIOD = 1.0 / 60.0
_TEXTS = 0.2

_KEYS = """\
**W S A D E Q** (Z S Q D E A) fly, arrows and mouse turn; **Space** plays and pauses.
"""


class Player:
    """Plays `run` on the pages of `server`; all pages see the same time."""

    def __init__(self, server: viser.ViserServer, run: Recorded, *, shadows: bool = True) -> None:
        """Build the page; `start` plays."""
        self.shown = -1
        """The frame that is shown."""
        self._run = run
        self._start_ns, self._end_ns = run.times[0], run.times[-1]
        self._time_ns = self._start_ns
        self._stage = Stage(server, shadows=shadows)
        self._sign = CameraSign(server.scene)
        self._lock = threading.Lock()
        self._woken = threading.Event()
        self._closing = False
        gui = server.gui
        gui.add_markdown(f'**{run.path.name}**')
        self._status = gui.add_markdown('')
        seconds = max(0.01, (self._end_ns - self._start_ns) / 1e9)
        self._playing: Any = gui.add_checkbox('Play (Space)', True)
        self._slider: Any = gui.add_slider(
            'Time, s', min=0.0, max=seconds, step=0.01, initial_value=0.0
        )
        self._speed = gui.add_dropdown('Speed', _SPEEDS, initial_value='1')
        self._again = gui.add_checkbox('Again from the start', True)
        self._heights = beside(gui, _KEYS)
        self._bind(gui)
        if run.ground is not None:
            self._stage.show_ground(run.ground)
        self._thread = threading.Thread(target=self._play, name='player', daemon=True)

    def start(self) -> None:
        """Begin to play."""
        self._thread.start()

    def close(self) -> None:
        """Stop."""
        self._closing = True
        self._woken.set()
        self._thread.join(5.0)

    def _bind(self, gui: viser.GuiApi) -> None:
        async def seek(event: Any) -> None:
            if event.client is not None:  # not put there by ourselves
                with self._lock:
                    self._time_ns = self._start_ns + round(event.target.value * 1e9)
                self._woken.set()

        async def wake(_: Any) -> None:
            self._woken.set()

        async def toggle(_: Any) -> None:
            self._playing.value = not self._playing.value

        self._slider.on_update(seek)
        self._playing.on_update(wake)
        gui.add_command('Play, pause', hotkey='space').on_trigger(toggle)

    def _play(self) -> None:
        before, texts_due = time.monotonic(), 0.0
        while not self._closing:
            now = time.monotonic()
            with self._lock:
                if self._playing.value:
                    self._advance(round((now - before) * 1e9 * float(self._speed.value)))
                time_ns = self._time_ns
            before = now
            self._show(time_ns)
            if now >= texts_due:
                texts_due = now + _TEXTS
                self._show_texts(time_ns)
            self._woken.wait(_PERIOD if self._playing.value else _TEXTS)
            self._woken.clear()

    def _advance(self, by_ns: int) -> None:
        self._time_ns += by_ns
        if self._time_ns > self._end_ns:
            if self._again.value:
                self._time_ns = self._start_ns
            else:
                self._time_ns = self._end_ns
                self._playing.value = False

    def _show(self, time_ns: int) -> None:
        index = self._run.index_at(time_ns)
        if index == self.shown:
            return
        self.shown = index
        size = self._run.settings_at(time_ns).get('cube_size', 0.5)
        self._stage.show_cubes(self._run.frames[index].astype(np.float64), size)
        camera = self._run.camera_at(time_ns)
        if camera is not None:
            self._sign.show(camera)

    def _show_texts(self, time_ns: int) -> None:
        run, index = self._run, self._run.index_at(time_ns)
        settings = run.settings_at(time_ns)
        self._status.content = (
            f'{settings.get("physics_model", "")} · **{len(run.frames[index])}** cubes · '
            f'**{time_ns / 1e9:.2f} s** of {self._end_ns / 1e9:.2f} s'
        )
        self._slider.value = (time_ns - self._start_ns) / 1e9
        first = run.index_at(time_ns - round(SPAN * 1e9))
        self._heights.clear()
        for at in range(first, index + 1):
            self._heights.add(run.times[at] / 1e9, run.frames[at][-CUBES:], len(run.frames[at]))
        self._heights.draw()
