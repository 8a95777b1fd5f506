"""The README names all that there is, and its table of parameters is up to date."""

from __future__ import annotations

import importlib.util
import re
from pathlib import Path

import pytest

from cube_sim.node import topics
from cube_sim.node.parameters import PARAMETERS
from cube_sim.physics.models import MODELS
from cube_sim.simulation.scenario import packaged_scenarios

ROOT = Path(__file__).parents[2]
README = (ROOT / 'README.md').read_text(encoding='utf-8')


def resolved(name: str) -> str:
    """A private name as a node called cube_sim has it."""
    return name.replace('~', '/cube_sim')


def test_the_table_of_parameters_is_that_of_the_code():
    spec = importlib.util.spec_from_file_location('make_tables', ROOT / 'docs' / 'make_tables.py')
    tables = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(tables)
    assert tables.with_table(README) == README, 'run .venv/bin/python docs/make_tables.py'


@pytest.mark.parametrize('topic', [*topics.PUBLISHED, *topics.SUBSCRIBED], ids=lambda t: t.name)
def test_every_topic_is_listed_with_its_type(topic):
    kind = topic.type_name.replace('/msg/', '/')
    assert f'| `{resolved(topic.name)}` | {kind} |' in README


def test_every_service_is_listed_with_its_type(ros, sim):
    node = sim()
    served = ros.node.get_service_names_and_types_by_node(node.get_name(), node.get_namespace())
    ours = [(name, kinds[0]) for name, kinds in served if kinds[0].startswith('std_srvs')]
    assert len(ours) == 6
    for name, kind in ours:
        assert f'| `{name}` | {kind.replace("/srv/", "/")} |' in README


def test_nothing_is_listed_that_there_is_not():
    listed = set(re.findall(r'^\| `(/[\w/]+)` \| \w+/', README, re.MULTILINE))
    known = {resolved(topic.name) for topic in (*topics.PUBLISHED, *topics.SUBSCRIBED)}
    services = {name for name in listed - known if f'| `{name}` | std_srvs/' in README}
    assert listed == known | services
    assert len(services) == 6


def test_every_parameter_model_and_packaged_scenario_is_mentioned():
    for name in (*PARAMETERS, *MODELS, *packaged_scenarios()):
        assert f'`{name}`' in README, name


def test_the_first_commands_are_targets_of_the_makefile():
    makefile = (ROOT / 'Makefile').read_text(encoding='utf-8')
    for target in re.findall(r'\bmake (?:PYTHON=\S+ )?(\w+)', README):
        assert re.search(rf'^{target}:', makefile, re.MULTILINE), target
