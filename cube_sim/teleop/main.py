"""The executable `teleop_key`."""

from __future__ import annotations

import argparse
import os
import sys
import time
from typing import TYPE_CHECKING

from cube_sim.teleop.flight import Flight
from cube_sim.teleop.keys import LAYOUTS, MOTIONS, KeyReader

if TYPE_CHECKING:
    from cube_sim.remote import Answer, SimulatorLink
    from cube_sim.teleop.terminal import Terminal

REFUSED = 2

# How often the screen is looked over when nothing happens, s.
_IDLE = 0.1
# Of a key that is held, a switch takes the first press and none that comes as fast as this, s.
_REPEAT = 0.15
# Throws that are still unanswered; more are not asked for.
_MOST_THROWS = 10

_DESCRIPTION = """\
Flies the camera of a simulator and throws cubes, from a terminal. The keys are those of the report:
Z S forward and back, Q D left and right, E A up and down, Space throws, Tab changes the physics
model; arrows turn the camera. --layout qwerty takes the keys in the same places of an English
keyboard: W S, A D, E Q. The key L changes between the two.
"""


def main(argv: list[str] | None = None) -> int:
    """Take keys until Escape or Ctrl-C; return the exit code."""
    given = sys.argv if argv is None else ['teleop_key', *argv]
    # What ROS is told stands behind --ros-args, and is none of ours.
    own = given[1 : given.index('--ros-args')] if '--ros-args' in given else given[1:]
    arguments = _parser().parse_args(own)
    if not (sys.stdin.isatty() and sys.stdout.isatty()):
        sys.stderr.write(
            'teleop_key: keys come from a terminal, and stdin or stdout is none. Start it in a '
            'terminal, or fly by topic: see msg_examples/topic_camera_cmd_vel.yaml.\n'
        )
        return REFUSED

    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from cube_sim.remote import SimulatorLink
    from cube_sim.teleop.terminal import Terminal

    try:
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
        link = SimulatorLink(arguments.simulator, name='teleop_key')
    except Exception as error:
        sys.stderr.write(f'teleop_key: {error}\n')
        rclpy.try_shutdown()
        return REFUSED
    keyboard = Keyboard(link, arguments.layout, Flight(arguments.speed, arguments.turn))
    try:
        with Terminal() as terminal:
            link.on_change = terminal.wake
            link.start()
            keyboard.run(terminal)
    finally:
        link.on_change = lambda: None
        link.close()
        rclpy.try_shutdown()
    if keyboard.bag:
        sys.stdout.write(f'bag: {keyboard.bag}\n')
    return 0


class Keyboard:
    """What each key does to the simulator at the other end of `link`."""

    def __init__(self, link: SimulatorLink, layout: str, flight: Flight) -> None:
        self.bag = ''
        """The last bag that was started or ended from here."""
        self._link = link
        self._layout = layout
        self._flight = flight
        self._reader = KeyReader()
        self._note = ''
        self._throws = 0
        self._asked: set[str] = set()
        self._last: dict[str, float] = {}
        self._left = False

    def run(self, terminal: Terminal) -> None:
        """Take keys and show what comes of them until the user leaves."""
        styled = not os.environ.get('NO_COLOR') and os.environ.get('TERM') != 'dumb'
        while not (terminal.ended or self._left):
            terminal.draw(lambda columns, rows: self._lines(columns, rows, styled))
            now = time.monotonic()
            waits = (self._reader.wait(now), self._flight.wait(now), _IDLE)
            data = terminal.wait(min(wait for wait in waits if wait is not None))
            now = time.monotonic()
            for key in self._reader.feed(data, now):
                self._press(LAYOUTS[self._layout].get(key, ''), now)
            velocity = self._flight.due(now, self._link.camera)
            if velocity is not None:
                self._link.fly(*velocity)

    def _press(self, action: str, now: float) -> None:
        if action in MOTIONS:
            self._flight.press(action, now)
        elif action == 'throw':
            if self._throws < _MOST_THROWS:
                self._throws += 1
                self._link.call('throw', self._thrown)
        elif action == 'step':
            self._call('step', None)
        elif action:
            repeated = now - self._last.get(action, -1.0) < _REPEAT
            self._last[action] = now
            if not repeated:
                self._switch(action)

    def _switch(self, action: str) -> None:
        status = self._link.status
        if action == 'leave':
            self._left = True
        elif action == 'layout':
            self._layout = 'qwerty' if self._layout == 'azerty' else 'azerty'
        elif action == 'pause':
            self._call('pause', not status.paused)
        elif action == 'record':
            self._call('record', not status.bag)
        else:
            self._call(action, None)

    def _call(self, service: str, data: bool | None) -> None:
        if service in self._asked:  # a slow answer is waited for once
            return
        self._asked.add(service)

        def done(answer: Answer) -> None:
            self._asked.discard(service)
            if answer.success and service == 'record':
                self.bag = answer.message
            said = {
                'next_model': f'model {answer.message}',
                'step': f'at {answer.message}',
                'record': f'recording {answer.message}' if data else f'recorded {answer.message}',
            }
            self._say(said.get(service, answer.message) if answer.success else answer.message)

        self._link.call(service, done, data)

    def _thrown(self, answer: Answer) -> None:
        self._throws -= 1
        self._say(f'cube {answer.message} thrown' if answer.success else answer.message)

    def _say(self, note: str) -> None:
        self._note = note
        self._link.on_change()

    def _lines(self, columns: int, rows: int, styled: bool) -> list[str]:
        from cube_sim.teleop.screen import View, lines

        link = self._link
        view = View(
            link.simulator, self._layout, link.present, link.status, link.camera, self._note
        )
        return lines(view, columns, rows, styled=styled)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='teleop_key',
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument('--layout', choices=sorted(LAYOUTS), default='azerty')
    parser.add_argument(
        '--simulator', default='/cube_sim', metavar='NAME', help='its node (default: /cube_sim)'
    )
    parser.add_argument(
        '--speed', type=float, default=3.0, metavar='M/S', help='of the flight (default: 3)'
    )
    parser.add_argument(
        '--turn', type=float, default=1.0, metavar='RAD/S', help='of the turns (default: 1)'
    )
    return parser


if __name__ == '__main__':
    sys.exit(main())
