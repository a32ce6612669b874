# SPDX-License-Identifier: Apache-2.0
"""How large the house is, is counted right."""

from importlib import util
from pathlib import Path

import pytest

SPEC = util.spec_from_file_location('house', Path(__file__).with_name('house.py'))
house = util.module_from_spec(SPEC)
SPEC.loader.exec_module(house)

FILE = '''\
# a comment
"""Three lines

of docstring."""

import os  # code


LIMIT = 3
"""One line on a constant."""


def f(x):
    """One line."""

    text = """two
lines"""
    return text, x
'''


def test_lines_are_code_or_docstring_or_neither(tmp_path):
    path = tmp_path / 'file.py'
    path.write_text(FILE, encoding='utf-8')
    assert house.lines(path) == (6, 5)


def test_circles_and_modules_with_one_user():
    graph = {'a': {'b'}, 'b': {'c'}, 'c': {'a', 'd'}, 'd': set(), 'e': {'d'}}
    assert house.circles(graph) == [['a', 'b', 'c']]
    assert house.imported_by_one(graph) == ['a', 'b', 'c']


def test_lines_that_are_written_twice(tmp_path):
    files = {}
    for name, first in (('one', 'begin = 0'), ('other', 'start = 1'), ('third', 'x = 5')):
        files[name] = tmp_path / f'{name}.py'
        body = [f'line_{k} = {k if name != "third" or k != 3 else 9}' for k in range(6)]
        files[name].write_text('\n'.join([first, *body]), encoding='utf-8')
    assert house.written_twice(files) == [('one', 'other')]


def test_names_that_are_imported_are_not_written_twice(tmp_path):
    names = '\n'.join(f'    name_{k},' for k in range(8))
    files = {name: tmp_path / f'{name}.py' for name in ('one', 'other')}
    for path in files.values():
        path.write_text(f'from some.module import (\n{names}\n)\n', encoding='utf-8')
    assert house.written_twice(files) == []


@pytest.fixture(scope='module')
def modules():
    return house.imports(house.files())


@pytest.mark.slow
def test_the_offline_rooms_stand_in_no_circle(modules):
    rooms = {name: targets for name, targets in modules.items() if '.offline.' in name}
    assert house.circles({n: t & rooms.keys() for n, t in rooms.items()}) == []


@pytest.mark.slow
def test_the_diagram_of_the_architecture_is_that_of_the_code():
    page = (Path(__file__).parents[1] / 'docs' / 'architecture.md').read_text(encoding='utf-8')
    assert house.diagram() in page, 'put in what `python test/house.py --diagram` prints'


@pytest.mark.slow
def test_no_module_imports_itself_by_way_of_others(modules):
    assert house.circles(modules) == []
