"""What /diagnostics says of a simulator."""

from __future__ import annotations

from dataclasses import dataclass

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

_SIMULATION, _RECORDER = 'cube_sim: simulation', 'cube_sim: recorder'


@dataclass(frozen=True)
class Status:
    """The state of a run, as of the last message or answer that told of it."""

    model: str = ''
    cubes: int = 0
    max_cubes: int = 0
    time_ns: int = 0
    """Simulated time."""
    paused: bool = False
    factor: float = 0.0
    """Simulated seconds for each second of the clock."""
    bag: str = ''
    """The bag that is being recorded, '' when none is."""
    warning: str = ''
    """What is not as it should be, '' when all is well."""


def status_of(message: DiagnosticArray) -> Status | None:
    """Return the status that a message holds; None when it is not from a simulator."""
    found = {status.name: status for status in message.status}
    if _SIMULATION not in found:
        return None
    simulation = found[_SIMULATION]
    values = {value.key: value.value for value in simulation.values}
    recorder = found.get(_RECORDER)
    warnings = [
        status.message
        for status in (simulation, recorder)
        if status is not None and status.level != DiagnosticStatus.OK
    ]
    recorded = {value.key: value.value for value in recorder.values} if recorder else {}
    return Status(
        model=values.get('model', ''),
        cubes=int(_number(values.get('cubes'))),
        max_cubes=int(_number(values.get('max_cubes'))),
        time_ns=round(_number(values.get('simulation time')) * 1e9),
        paused=simulation.message == 'paused',
        factor=_number(values.get('real-time factor')),
        bag=recorded.get('bag', ''),
        warning='; '.join(warnings),
    )


def _number(text: str | None) -> float:
    """Return the number that a value starts with, without its unit."""
    try:
        return float((text or '0').split()[0])
    except (ValueError, IndexError):
        return 0.0
