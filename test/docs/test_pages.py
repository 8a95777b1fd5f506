"""What the README and the pages of docs/ say is so."""

from __future__ import annotations

import importlib.util
import re
import threading
from pathlib import Path
from types import ModuleType

import pytest

from cube_sim.simulation import Scenario, ScenarioError
from cube_sim.simulation.parameters import CHANGEABLE
from cube_sim.simulation.scenario import ACTIONS, packaged_scenarios

ROOT = Path(__file__).parents[2]
PAGES = [ROOT / 'README.md', *sorted((ROOT / 'docs').glob('*.md'))]
SCENARIO_PAGES = [ROOT / 'README.md', ROOT / 'docs' / 'scenarios.md']

LINK = re.compile(r'\[[^\]]*\]\(([^)#\s]+)(?:#[^)]*)?\)')
# A path from the checkout's top; the names of topics begin with a slash.
PATH = re.compile(r'(?<![\w/.~-])(?:cube_sim|docs|test|msg_examples|requirements)/[\w./-]*\w')


def blocks(page: Path, language: str) -> list[str]:
    """The code blocks of a page in that language."""
    text = page.read_text(encoding='utf-8')
    return re.findall(rf'^```{language}\n(.*?)^```$', text, re.MULTILINE | re.DOTALL)


def loaded(path: Path) -> ModuleType:
    """A script as a module."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


PYTHON = [
    pytest.param(block, id=f'{page.name}-{number}')
    for page in PAGES
    for number, block in enumerate(blocks(page, 'python'), 1)
]


@pytest.fixture
def recordings(sim, tmp_path, monkeypatch):
    """A working directory in which `recordings` has a bag of the README's scenario."""
    monkeypatch.chdir(tmp_path)
    (scenario,) = blocks(ROOT / 'README.md', 'yaml')
    Path('scenario.yaml').write_text(scenario)
    finished = threading.Event()
    node = sim(
        record=True,
        bag_directory='recordings',
        scenario='scenario.yaml',
        real_time_factor=0.0,
        duration=5.0,
        options={'on_finished': finished.set},
    )
    assert finished.wait(20.0)
    return node.close()


@pytest.mark.parametrize('block', PYTHON)
def test_python_on_the_pages_runs(block, recordings, capsys):
    assert recordings.is_dir()
    exec(compile(block, 'block', 'exec'), {'__name__': '__main__'})
    if 'print(' in block:
        assert capsys.readouterr().out


def test_there_is_python_to_run():
    assert len(PYTHON) >= 5


def test_the_snippet_that_simulates_a_bag_again_compares_every_pose(recordings, capsys):
    block = blocks(ROOT / 'docs' / 'recording.md', 'python')[-1]
    exec(compile(block, 'block', 'exec'), {})
    assert capsys.readouterr().out == '250 messages are equal to the bit\n'


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_every_relative_link_leads_somewhere(page):
    for target in LINK.findall(page.read_text(encoding='utf-8')):
        if '://' not in target:
            assert (page.parent / target).exists(), target


def test_the_readme_leads_to_every_page():
    targets = LINK.findall(PAGES[0].read_text(encoding='utf-8'))
    assert {f'docs/{page.name}' for page in PAGES[1:]} <= set(targets)


@pytest.mark.parametrize('page', PAGES, ids=lambda page: page.name)
def test_every_path_that_is_mentioned_exists(page):
    for path in PATH.findall(page.read_text(encoding='utf-8')):
        assert (ROOT / path).exists(), path


@pytest.mark.parametrize('page', SCENARIO_PAGES, ids=lambda page: page.name)
def test_the_scenarios_on_the_pages_can_be_played(page):
    found = blocks(page, 'yaml')
    assert found
    for text in found:
        assert Scenario.parse(text).entries


def test_the_errors_of_scenarios_are_worded_as_the_page_says():
    text = (ROOT / 'docs' / 'scenarios.md').read_text(encoding='utf-8')
    rows = re.findall(r'^\| `(- \{.*?)` \| `(my\.yaml:.*)` \|$', text, re.MULTILINE)
    assert len(rows) >= 5
    for entry, error in rows:
        with pytest.raises(ScenarioError) as caught:
            Scenario.parse(entry, 'my.yaml')
        assert str(caught.value) == error


def test_the_page_of_scenarios_has_every_action_key_and_name():
    text = (ROOT / 'docs' / 'scenarios.md').read_text(encoding='utf-8')
    names = {*ACTIONS, *(key for keys in ACTIONS.values() for key in keys), *CHANGEABLE}
    for name in (*names, *packaged_scenarios()):
        assert f'`{name}`' in text, name


def test_the_pictures_are_made_and_small(tmp_path):
    pytest.importorskip('matplotlib')
    assert loaded(ROOT / 'docs' / 'make_pictures.py').main([str(tmp_path)]) == 0
    made = {path.name for path in tmp_path.glob('*.png')}
    kept = {path.name: path for path in (ROOT / 'docs').glob('*.png')}
    assert made | {'page.png', 'contact.png'} == set(kept)  # those two are screenshots of web_view
    for path in (*kept.values(), *tmp_path.glob('*.png')):
        assert 10_000 < path.stat().st_size < 200_000
