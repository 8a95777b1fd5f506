"""How the run is going, as diagnostic_msgs."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from cube_sim.recording import Recorder
from cube_sim.simulation.runner import Progress, Runner
from cube_sim.simulation.simulation import Simulation

# Below this share of the real-time factor that was asked for, the status is a warning.
BEHIND = 0.98


def diagnostic_array(
    simulation: Simulation,
    runner: Runner,
    recorder: Recorder | None,
    before: Progress,
    now: Progress,
    dropped_before: int,
) -> DiagnosticArray:
    """Return the state of simulation and recorder; rates are those between the two counts."""
    array = DiagnosticArray(
        status=[
            _simulation_status(simulation, runner, before, now),
            _recorder_status(recorder, dropped_before),
        ]
    )
    seconds, array.header.stamp.nanosec = divmod(now.sim_ns, 1_000_000_000)
    array.header.stamp.sec = seconds
    return array


def achieved_factor(before: Progress, now: Progress) -> float:
    """Return simulated seconds for each second of the clock between two counts."""
    return (now.sim_ns - before.sim_ns) / max(1, now.wall_ns - before.wall_ns)


def _simulation_status(
    simulation: Simulation, runner: Runner, before: Progress, now: Progress
) -> DiagnosticStatus:
    factor = achieved_factor(before, now)
    asked = runner.real_time_factor
    wall_ns = max(1, now.wall_ns - before.wall_ns)
    steps = now.steps - before.steps
    physics_ns = now.physics_ns - before.physics_ns
    messages_ns = now.messages_ns - before.messages_ns
    overruns = now.overruns - before.overruns
    level, message = DiagnosticStatus.OK, 'running'
    if runner.paused:
        message = 'paused'
    elif simulation.finished:
        message = 'finished'
    elif overruns and factor < BEHIND * asked:
        level = DiagnosticStatus.WARN
        message = f'behind: {factor:.2f} of a real-time factor of {asked:g}'
    world = simulation.world
    settings = world.settings
    return _status(
        'simulation',
        level,
        message,
        {
            'simulation time': f'{now.sim_ns / 1e9:.3f} s',
            'model': settings.model,
            'cubes': len(world),
            'awake': world.awake,
            'max_cubes': simulation.throwing.max_cubes,
            'contacts': world.contacts,
            'contact points': len(world.contact_points.positions),
            # What the last step of the model took; only contact has such counters.
            **{name.replace('_', ' '): count for name, count in world.counters.items()},
            'real-time factor': f'{factor:.3f}',
            'real-time factor asked for': f'{asked:g}' if asked else 'as fast as it can',
            'step cost': f'{physics_ns / 1e3 / steps:.2f} us' if steps else 'no steps',
            'physics share of a CPU': f'{100 * physics_ns / wall_ns:.1f} %',
            'messages share of a CPU': f'{100 * messages_ns / wall_ns:.1f} %',
            'overruns': now.overruns,
            'time given up': f'{now.lost_ns / 1e9:.3f} s',
        },
    )


def _recorder_status(recorder: Recorder | None, dropped_before: int) -> DiagnosticStatus:
    if recorder is None:
        return _status('recorder', DiagnosticStatus.OK, 'not recording', {})
    level, message = DiagnosticStatus.OK, 'recording'
    if recorder.error is not None:
        level, message = DiagnosticStatus.ERROR, recorder.error
    elif recorder.drops > dropped_before:
        level, message = DiagnosticStatus.WARN, 'dropping messages: the disk is too slow'
    elif recorder.drops:
        message = 'recording; the bag lacks messages'
    return _status(
        'recorder',
        level,
        message,
        {
            'bag': recorder.path,
            'messages': recorder.messages,
            'bytes': recorder.bytes,
            'drops': recorder.drops,
            'files': recorder.files,
            'resumed': recorder.resumed,
            'waiting': f'{recorder.waiting_bytes} bytes',
        },
    )


def _status(name: str, level: bytes, message: str, values: dict[str, object]) -> DiagnosticStatus:
    return DiagnosticStatus(
        level=level,
        name=f'cube_sim: {name}',
        message=message,
        hardware_id='cube_sim',
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
