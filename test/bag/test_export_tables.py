"""`cube_bag export`: tables that read back to what was recorded."""

from __future__ import annotations

import csv
import json
import re
import sys
from pathlib import Path

import numpy as np
import pytest
from support.bags import record_run, throws

from cube_sim.bag import table_files
from cube_sim.bag.columns import BOUNCES, STATES
from cube_sim.bag.main import main
from cube_sim.messages.decode import read_pose_array
from cube_sim.physics import Settings, World
from cube_sim.recording.reader import BagReader

DOCUMENT = Path(__file__).parents[2] / 'docs' / 'cube_bag.md'
POSE = ('x_m', 'y_m', 'z_m', 'qx', 'qy', 'qz', 'qw')
VELOCITY = ('vx_m_s', 'vy_m_s', 'vz_m_s', 'wx_rad_s', 'wy_rad_s', 'wz_rad_s')
SCENARIO = throws(4, every=0.2) + '- {at: 1.5, reset: {}}\n- {at: 1.6, throw: {}}\n'


@pytest.fixture
def bag(tmp_path):
    return record_run(tmp_path / 'run', SCENARIO, 2.0, model='impulse')


def export(capsys, *arguments):
    code = main(['export', *map(str, arguments)])
    out, err = capsys.readouterr()
    return code, out, err


def recorded(bag):
    with BagReader(bag) as reader:
        arrays = [read_pose_array(m.data) for m in reader.messages(['/cube_sim/poses'])]
    times = np.concatenate([[array.time_ns / 1e9] * len(array.poses) for array in arrays])
    return times, np.concatenate([array.poses for array in arrays])


def rows_of(path):
    with path.open(newline='') as file:
        return list(csv.DictReader(file))


def test_csv_reads_back_to_the_bits_of_the_bag(capsys, bag, tmp_path):
    code, _, err = export(capsys, bag, '-o', tmp_path / 'states.csv')
    assert (code, err) == (0, '')
    table = np.genfromtxt(
        tmp_path / 'states.csv', delimiter=',', names=True, dtype=None, encoding='utf-8'
    )
    times, poses = recorded(bag)
    assert table.dtype.names == tuple(column.name for column in STATES)
    assert np.array_equal(table['time_s'], times)
    assert np.array_equal(np.stack([table[name] for name in POSE], axis=1), poses)
    assert set(table['velocity_source']) == {'replay'}
    assert np.array_equal(np.unique(table['generation']), [0, 1])


def test_parquet_reads_back_to_the_bits_of_the_bag_with_units(capsys, bag, tmp_path, monkeypatch):
    parquet = pytest.importorskip('pyarrow.parquet')
    monkeypatch.setattr(table_files, 'GROUP', 100)
    assert export(capsys, bag, '-o', tmp_path / 'states.parquet')[0] == 0
    table = parquet.read_table(tmp_path / 'states.parquet')
    times, poses = recorded(bag)
    assert np.array_equal(table['time_s'].to_numpy(), times)
    assert np.array_equal(np.stack([table[name].to_numpy() for name in POSE], axis=1), poses)
    assert table.schema.field('vx_m_s').metadata[b'unit'] == b'm/s'
    assert table.schema.metadata[b'method'] == b'replay'
    assert parquet.ParquetFile(tmp_path / 'states.parquet').num_row_groups > 1
    bounces = parquet.read_table(tmp_path / 'states_bounces.parquet')
    assert bounces.column_names == [column.name for column in BOUNCES]
    np.testing.assert_allclose(bounces['restitution'].to_numpy(), 0.5, atol=1e-9)


def test_replayed_velocities_are_those_of_the_simulation(capsys, tmp_path):
    bag = record_run(tmp_path / 'run', '- {at: 0.0, throw: {}}\n', 2.0)
    export(capsys, bag, '-o', tmp_path / 's.csv')
    world = World(Settings())
    world.throw((0, 0, 1.5), (0, 0, 0, 1), (8.0, 0, 0), (1, 2, 3))
    for row in rows_of(tmp_path / 's.csv'):
        world.step(10)
        assert [float(row[name]) for name in VELOCITY] == world.velocities[0].tolist()


def test_estimated_velocities_say_so_and_are_those_of_the_flight(capsys, tmp_path):
    bag = record_run(tmp_path / 'run', '- {at: 0.0, throw: {}}\n', 2.0)
    export(capsys, bag, '-o', tmp_path / 'exact.csv')
    export(capsys, bag, '-o', tmp_path / 'estimated.csv', '--from-poses')
    exact, estimated = rows_of(tmp_path / 'exact.csv'), rows_of(tmp_path / 'estimated.csv')
    assert {row['velocity_source'] for row in estimated} == {'flight', 'difference'}
    for ours, theirs in zip(estimated[:20], exact[:20], strict=True):
        assert float(ours['vx_m_s']) == pytest.approx(float(theirs['vx_m_s']), abs=1e-9)
        # Half a step of gravity: the parabola of the poses and the integrator's velocity.
        assert float(ours['vz_m_s']) - float(theirs['vz_m_s']) == pytest.approx(
            -0.5 * 9.81 * 0.002, abs=1e-9
        )


def test_the_table_of_bounces_holds_what_the_report_says(capsys, bag, tmp_path):
    export(capsys, bag, '-o', tmp_path / 's.csv')
    main(['report', '--json', '--bounces', str(bag)])
    (document,) = json.loads(capsys.readouterr().out)['bags']
    rows = rows_of(tmp_path / 's_bounces.csv')
    assert len(rows) == len(document['bounces']) > 0
    for row, bounce in zip(rows, document['bounces'], strict=True):
        assert set(row) == set(bounce)
        for key, value in bounce.items():
            assert row[key] == ('' if value is None else str(value))


def test_every_column_is_documented_with_its_unit():
    text = DOCUMENT.read_text()
    for column in (*STATES, *BOUNCES):
        assert f'| `{column.name}` | {column.unit} | {column.meaning} |' in text
        suffix = re.search(r'_(m|s|m_s|rad_s|j)$', column.name)
        assert bool(column.unit) == bool(suffix), column.name


def test_files_that_exist_are_not_overwritten_unasked(capsys, bag, tmp_path):
    target = tmp_path / 's.csv'
    (tmp_path / 's_bounces.csv').write_text('mine')
    code, _, err = export(capsys, bag, '-o', target)
    assert code == 2
    assert 's_bounces.csv exists already, not overwriting' in err
    assert not target.exists()
    assert export(capsys, bag, '-o', target, '--overwrite')[0] == 0
    assert (tmp_path / 's_bounces.csv').read_text() != 'mine'


def test_an_ending_that_says_nothing_asks_for_a_format(capsys, bag, tmp_path):
    code, _, err = export(capsys, bag, '-o', tmp_path / 's.dat')
    assert code == 2
    assert 'choose with --format' in err
    assert export(capsys, bag, '-o', tmp_path / 's.dat', '--format', 'csv')[0] == 0
    assert (tmp_path / 's_bounces.dat').is_file()


def test_the_default_is_a_csv_of_the_bag_s_name_here(capsys, bag, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, _ = export(capsys, bag, '--json')
    assert code == 0
    assert json.loads(out)['states']['path'] == 'run.csv'
    assert (tmp_path / 'run_bounces.csv').is_file()


def test_without_pyarrow_parquet_is_refused_in_one_sentence(capsys, bag, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, 'pyarrow', None)
    code, _, err = export(capsys, bag, '-o', tmp_path / 's.parquet')
    assert code == 2
    assert err.strip() == (
        'cube_bag: Parquet needs pyarrow: install it with pip install pyarrow, '
        'or choose --format csv.'
    )
    assert list(tmp_path.glob('s*')) == []


def test_a_bag_without_cubes_makes_tables_without_rows(capsys, tmp_path):
    bag = record_run(tmp_path / 'run', '', 0.5)
    assert export(capsys, bag, '-o', tmp_path / 's.csv')[0] == 0
    assert rows_of(tmp_path / 's.csv') == []
    assert rows_of(tmp_path / 's_bounces.csv') == []
    if pytest.importorskip('pyarrow.parquet'):
        assert export(capsys, bag, '-o', tmp_path / 's.parquet')[0] == 0
