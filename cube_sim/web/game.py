"""The executable `cube_sim_game`: the simulator and its page in one process."""

from __future__ import annotations

import argparse
import os
import shutil
import subprocess
import sys
import threading

from cube_sim.web import address
from cube_sim.web.main import REFUSED, announce, asked_to_stop, say

_KEYS = """\

  W S A D E Q   fly the page's camera (on AZERTY: Z S Q D E A); arrows and mouse turn it
  Space         throw a cube from where the page looks
  Tab           next physics model
  R P N B       remove all cubes, pause, one step, record
  Ctrl-C        end, here
"""
_DESCRIPTION = """\
Starts a simulator and its page together. What stands behind --ros-args is the simulator's, such as
-p physics_model:=impulse.
"""


def main(argv: list[str] | None = None) -> int:
    """Run simulator and page until Ctrl-C or the simulator's end; return the exit code."""
    given = sys.argv if argv is None else ['cube_sim_game', *argv]
    at = given.index('--ros-args') if '--ros-args' in given else len(given)
    arguments = _parser().parse_args(given[1:at])
    try:
        address.check(arguments.host, arguments.port)
    except address.AddressError as error:
        sys.stderr.write(f'cube_sim_game: {error}\n')
        return REFUSED
    stop = asked_to_stop()

    import rclpy
    from rclpy.signals import SignalHandlerOptions

    try:
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as error:
        sys.stderr.write(f'cube_sim_game: {error}\n')
        return REFUSED
    try:
        _run(arguments, stop)
    finally:
        rclpy.try_shutdown()
    return 0


def _run(arguments: argparse.Namespace, stop: threading.Event) -> None:
    from cube_sim.node.live_line import LiveLine
    from cube_sim.node.node import SimNode
    from cube_sim.remote import Serving, SimulatorLink
    from cube_sim.web.live import Live
    from cube_sim.web.stage import serving

    # In one process nothing has to be discovered: the page shows the first cube at once.
    node = SimNode(on_finished=stop.set)
    simulator = Serving(node)
    simulator.start()
    bag = None
    try:
        with serving(arguments.host, arguments.port, 'cube_sim') as server:
            link = SimulatorLink(node.get_fully_qualified_name(), name='web_view')
            live = Live(server, link, shadows=arguments.shadows)
            live.start()
            try:
                announce(arguments.host, arguments.port, server.get_port())
                if arguments.open:
                    _open(address.url(arguments.host, server.get_port()))
                say(_KEYS)
                line = LiveLine.on_stdout(node.simulation, node.runner.progress())
                while not stop.wait(line.period):
                    line.show(node.runner.progress(), '   paused' if node.runner.paused else '')
                line.close()
            finally:
                live.close()
    finally:
        bag = node.close()
        simulator.close()
        if bag is not None:
            say(f'bag: {bag}')


def _open(url: str) -> None:
    """Open the page where there is a desktop; a browser of its own session outlives Ctrl-C."""
    opener = shutil.which('xdg-open')
    if opener and (os.environ.get('DISPLAY') or os.environ.get('WAYLAND_DISPLAY')):
        subprocess.Popen(
            [opener, url],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='cube_sim_game',
        description=_DESCRIPTION,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    address.add_arguments(parser)
    parser.add_argument(
        '--no-open', dest='open', action='store_false', help='open no browser by itself'
    )
    return parser


if __name__ == '__main__':
    sys.exit(main())
