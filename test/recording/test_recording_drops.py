from __future__ import annotations

import json

from cube_sim.recording import DropLog, Gap

SECOND = 1_000_000_000


def test_what_is_dropped_within_a_second_is_one_gap():
    log = DropLog()
    assert log.add(10 * SECOND, 10 * SECOND, {'/a': 1})
    assert not log.add(11 * SECOND, 11 * SECOND, {'/b': 2})
    assert log.add(13 * SECOND, 14 * SECOND, {'/a': 1})
    assert log.gaps == (
        Gap(10 * SECOND, 11 * SECOND, 3),
        Gap(13 * SECOND, 14 * SECOND, 1),
    )
    assert log.total == 4


def test_a_gap_that_lies_before_or_around_others_finds_its_place():
    log = DropLog()
    log.add(10 * SECOND, 12 * SECOND, {'/a': 1})
    log.add(1 * SECOND, 2 * SECOND, {'/a': 1})
    assert log.gaps == (Gap(1 * SECOND, 2 * SECOND, 1), Gap(10 * SECOND, 12 * SECOND, 1))
    log.add(2 * SECOND, 20 * SECOND, {'/a': 5})
    assert log.gaps == (Gap(1 * SECOND, 20 * SECOND, 7),)


def test_the_notes_name_number_gaps_and_topics():
    log = DropLog()
    assert log.notes() == {'drops': '0'}
    log.add(0, 0, {})
    log.add_undated(2)
    assert log.notes() == {'drops': '2'}
    log.add(5, 9, {'/b': 1, '/a': 2})
    notes = log.notes()
    assert notes['drops'] == '5'
    assert json.loads(notes['gaps']) == [[5, 9, 3]]
    assert json.loads(notes['drops_by_topic']) == {'/a': 2, '/b': 1}


def test_there_are_never_more_than_a_hundred_gaps_and_none_is_forgotten():
    log = DropLog()
    times = [index * index * 10 * SECOND for index in range(300)]
    for time_ns in times:
        log.add(time_ns, time_ns, {'/a': 1})
    gaps = log.gaps
    assert len(gaps) == 100
    assert sum(gap.messages for gap in gaps) == log.total == 300
    assert all(any(gap.start_ns <= time <= gap.end_ns for gap in gaps) for time in times)
    assert gaps[-1] == Gap(times[-1], times[-1], 1), 'the nearest ones are joined, not the last'
