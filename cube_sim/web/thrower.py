"""Thrower: places the camera, then throws, one page after the other."""

from __future__ import annotations

import queue
import threading
import time
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cube_sim.remote import Answer, SimulatorLink
from cube_sim.remote.link import ANSWER_DEADLINE
from cube_sim.web.axes import same_pose

Floats = NDArray[np.float64]
Done = Callable[[Answer], None]

# How long the camera may take to be where it was put, s; it is asked again in between.
_PLACED_WITHIN = 2.0
_ASK_AGAIN = 0.5


class Thrower:
    """
    Throws from the cameras of many pages.

    A throw is a pair: the camera is placed, and once the simulator has said that it is there,
    thrown from. Pairs come one after the other, so no page throws from another one's camera.
    """

    def __init__(self, link: SimulatorLink) -> None:
        """Throw through `link`; `start` begins."""
        self._link = link
        self._wanted: Floats | None = None
        self._placed = threading.Event()
        self._queue: queue.SimpleQueue[tuple[Floats, Done] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name='throws', daemon=True)

    def start(self) -> None:
        """Begin to take throws."""
        self._thread.start()

    def close(self) -> None:
        """Stop behind the throw that is under way."""
        self._queue.put(None)
        self._thread.join(_PLACED_WITHIN + ANSWER_DEADLINE)

    def throw(self, pose: Floats, done: Done) -> None:
        """Throw from x y z qx qy qz qw, m; `done` gets the answer, on some thread."""
        self._queue.put((pose, done))

    def camera_is_at(self, pose: Floats) -> None:
        """Take note of where the simulator says that its camera is."""
        wanted = self._wanted
        if wanted is not None and same_pose(pose, wanted):
            self._placed.set()

    def _work(self) -> None:
        while (item := self._queue.get()) is not None:
            pose, done = item
            if self._place(pose):
                answered = threading.Event()
                answers: list[Answer] = []

                def take(
                    answer: Answer, into: list[Answer] = answers, event: threading.Event = answered
                ) -> None:
                    into.append(answer)
                    event.set()

                self._link.call('throw', take)
                answered.wait(2.0 * ANSWER_DEADLINE)
                done(answers[0] if answers else Answer(False, 'No answer came.'))
            elif self._link.present:
                done(Answer(False, 'The simulator does not take the camera of this page.'))
            else:
                done(Answer(False, self._link.absence))

    def _place(self, pose: Floats) -> bool:
        self._placed.clear()
        self._wanted = pose
        deadline = time.monotonic() + _PLACED_WITHIN
        try:
            while self._link.present and time.monotonic() < deadline:
                self._link.place(pose)
                if self._placed.wait(_ASK_AGAIN):
                    return True
            return False
        finally:
            self._wanted = None
