"""Diagnostics: how the run and the recorder are doing, once a second."""

from __future__ import annotations

from diagnostic_msgs.msg import DiagnosticStatus

from cube_sim.simulation import runner


def statuses(array):
    """Each status by the last word of its name, and its values by key."""
    return {
        status.name.split(': ')[1]: (status, {item.key: item.value for item in status.values})
        for status in array.status
    }


def test_the_diagnostics_tell_pace_cubes_overruns_and_recorder(ros, sim):
    sim()
    diagnostics = ros.listen('/diagnostics')
    ros.do('throw')
    status, values = statuses(diagnostics.wait_for())['simulation']
    assert status.hardware_id == 'cube_sim'
    assert status.level in (DiagnosticStatus.OK, DiagnosticStatus.WARN)
    assert values['cubes'] == '1'
    assert values['model'] == 'simple'
    assert float(values['real-time factor']) > 0
    assert values['real-time factor asked for'] == '1'
    assert int(values['overruns']) >= 0
    assert values['step cost'].endswith(' us')
    recorder, _ = statuses(diagnostics.last)['recorder']
    assert recorder.message == 'not recording'
    bag = ros.do('record', True)

    def records(array):
        return statuses(array)['recorder'][0].message == 'recording'

    _, values = statuses(diagnostics.wait_for(records))['recorder']
    assert values['bag'] == bag
    assert int(values['messages']) > 0
    assert int(values['bytes']) > 0
    assert values['drops'] == '0'


def test_a_paused_run_is_told_as_such_and_not_as_behind(ros, sim):
    sim(start_paused=True)
    diagnostics = ros.listen('/diagnostics')
    status, values = statuses(diagnostics.wait_for())['simulation']
    assert (status.level, status.message) == (DiagnosticStatus.OK, 'paused')
    assert values['step cost'] == 'no steps'


def test_a_run_that_cannot_keep_up_is_a_warning_with_overruns(ros, sim, monkeypatch):
    # Nothing is made up for, so that every batch of a factor beyond reach is late.
    monkeypatch.setattr(runner, 'CATCH_UP', 0.0)
    sim(real_time_factor=1000.0, publish_rate=500.0, time_step=1e-6)
    diagnostics = ros.listen('/diagnostics')

    def behind(array):
        return statuses(array)['simulation'][0].level == DiagnosticStatus.WARN

    status, values = statuses(diagnostics.wait_for(behind))['simulation']
    assert status.message.startswith('behind')
    assert int(values['overruns']) > 0
    assert not values['time given up'].startswith('0.000')
