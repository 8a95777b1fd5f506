"""`cube_bag report` as it is called."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path

import pytest
from support.bags import drop, record_poses, record_run, throws

from cube_sim.bag.main import main

DOCUMENT = Path(__file__).parents[2] / 'docs' / 'cube_bag.md'


@pytest.fixture
def bag(tmp_path):
    return record_run(tmp_path / 'run', throws(3, every=0.1), 1.5, model='impulse')


def report(capsys, *arguments):
    """Run the command; return its exit code, what it printed, and its errors."""
    code = main(['report', *map(str, arguments)])
    out, err = capsys.readouterr()
    return code, out, err


def as_json(capsys, *arguments):
    code, out, err = report(capsys, '--json', *arguments)
    assert (code, err) == (0, '')
    return json.loads(out)['bags']


def keys(value):
    if isinstance(value, dict):
        for key, item in value.items():
            yield key
            yield from keys(item)
    elif isinstance(value, list):
        for item in value:
            yield from keys(item)


def test_every_key_of_the_json_is_documented(capsys, bag, tmp_path):
    described = set(re.findall(r'`(\w+)`', DOCUMENT.read_text()))
    documents = as_json(capsys, bag, '--bounces', '--figures', tmp_path / 'figures')
    documents += as_json(capsys, bag, '--from-poses')
    assert documents[1]['method'] == 'poses'
    assert set(keys(documents)) - described == set()


def test_json_holds_the_run(capsys, bag):
    (document,) = as_json(capsys, bag)
    assert document['method'] == 'replay'
    assert document['cubes_in_all'] == 3
    assert len(document['bounces']) == document['bounces_in_all']
    assert {bounce['model'] for bounce in document['bounces']} == {'impulse'}
    assert document['measured'][0]['restitution']['median'] == pytest.approx(0.5, abs=1e-9)
    assert abs(document['energy']['residue_j']) < 1e-9
    times = [bounce['time_s'] for bounce in document['bounces']]
    assert times == sorted(times)


def test_bounces_of_many_cubes_are_listed_when_asked_for(capsys, tmp_path):
    bag = record_run(tmp_path / 'many', throws(5), 1.0)
    assert 'bounces' not in as_json(capsys, bag)[0]
    assert 'bounces' in as_json(capsys, bag, '--bounces')[0]


def test_the_terminal_gets_a_summary_and_a_line_for_each_cube(capsys, monkeypatch, bag):
    monkeypatch.setenv('COLUMNS', '140')
    code, out, err = report(capsys, bag)
    assert (code, err) == (0, '')
    assert 'simulated again, exact at every step' in out
    assert 'model impulse, restitution 0.5' in out
    assert 'bounces of cube 2' in out
    assert 'measured at bounces' in out


def test_estimates_say_how_good_they_are(capsys, bag):
    _, out, _ = report(capsys, bag, '--from-poses')
    assert 'nine of ten are within ±3.5 ms' in out
    assert 'too close to tell' in out


def test_several_bags_are_reported_one_after_the_other(capsys, bag, tmp_path):
    other = record_run(tmp_path / 'other', drop(), 1.0)
    documents = as_json(capsys, bag, other, '--figures', tmp_path / 'figures')
    assert [Path(document['bag']).name for document in documents] == ['run', 'other']
    assert not set(documents[0]['figures']) & set(documents[1]['figures'])


def test_figures_are_png_and_svg_with_the_same_bytes_each_time(capsys, bag, tmp_path):
    first = as_json(capsys, bag, '--figures', tmp_path / 'a')[0]['figures']
    second = as_json(capsys, bag, '--figures', tmp_path / 'b')[0]['figures']
    names = {Path(path).name for path in first}
    for name in ('height', 'energy', 'energy_by_cube', 'bounces', 'phase'):
        assert {f'{name}.png', f'{name}.svg'} <= names
    for one, other in zip(map(Path, first), map(Path, second), strict=True):
        content = one.read_bytes()
        assert content.startswith(b'\x89PNG' if one.suffix == '.png' else b'<?xml')
        assert content == other.read_bytes()


def test_the_page_loads_nothing(capsys, bag, tmp_path):
    other = record_run(tmp_path / '<b>&', throws(15, every=0.01), 1.0)
    page = tmp_path / 'pages' / 'report.html'
    code, _, err = report(capsys, bag, other, '--bounces', '--html', page)
    assert (code, err) == (0, '')
    content = page.read_text()
    assert re.findall(r'https?:', content) == []
    loads = re.findall(r'(?:src|href|srcset|action|data)\s*=\s*["\']?([^"\'\s>]{5})', content)
    assert loads
    assert set(loads) == {'data:'}
    assert not re.search(r'<(script|link|iframe|object)|@import|url\(', content)
    assert '<h1>&lt;b&gt;&amp;</h1>' in content


def test_without_matplotlib_figures_are_refused_in_one_sentence(capsys, monkeypatch, bag, tmp_path):
    for name in [name for name in sys.modules if name.split('.')[0] == 'matplotlib']:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'matplotlib', None)
    code, _, err = report(capsys, bag, '--figures', tmp_path / 'figures')
    assert code == 2
    assert err.strip() == (
        'cube_bag: Figures need matplotlib: install it with pip install matplotlib.'
    )
    assert report(capsys, bag)[0] == 0


@pytest.mark.parametrize('scenario', ['', '- {at: 0.005, throw: {}}\n'])
@pytest.mark.parametrize('seconds', [0.004, 0.02, 0.1])
@pytest.mark.parametrize('option', [(), ('--from-poses',)])
def test_bags_with_nothing_much_in_them_are_reported(capsys, tmp_path, scenario, seconds, option):
    bag = record_run(tmp_path / 'bag', scenario, seconds)
    code, _, err = report(
        capsys, bag, *option, '--html', tmp_path / 'p.html', '--figures', tmp_path / 'figures'
    )
    assert (code, err) == (0, '')
    (document,) = as_json(capsys, bag, *option)
    assert document['bounces_in_all'] == 0


def test_poses_of_others_are_reported_with_what_was_assumed(capsys, tmp_path):
    pose = [0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 1.0]
    bag = record_poses(tmp_path / 'bag', [(i * 20_000_000, [pose, pose]) for i in range(100)])
    (document,) = as_json(capsys, bag)
    assert document['cubes_at_rest'] == 2
    assert document['cubes'][0]['rest_time_s'] == 0.0
    assert 'assumed' in document['notes'][0]
    assert as_json(capsys, bag, '--topic', '/mocap/cubes')[0]['cubes_in_all'] == 2


def test_a_bag_that_is_not_there_is_one_sentence_and_exit_code_2(capsys, tmp_path):
    code, out, err = report(capsys, tmp_path / 'nothing')
    assert (code, out) == (2, '')
    assert err.startswith('cube_bag: ')
    assert err.count('\n') == 1


def test_noise_that_is_none_is_refused(capsys, bag):
    code, _, err = report(capsys, bag, '--noise', '-1')
    assert code == 2
    assert '--noise is -1.0' in err
