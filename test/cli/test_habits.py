# SPDX-License-Identifier: Apache-2.0
"""What people expect of any command: quiet, no colours, a man page, a hint where to begin."""

from importlib import util
from pathlib import Path
import re

from imu_bench.cli import main as entry
from imu_bench.cli.main import build_parser, verb_names
import pytest

DOCS = Path(__file__).resolve().parents[2] / 'docs'
COLOUR = re.compile(r'\x1b\[(?:\d+;)*(?:3[0-7]|4[0-7]|9[0-7])[;m]')


@pytest.fixture(scope='module')
def reference():
    spec = util.spec_from_file_location('reference', DOCS / 'reference.py')
    module = util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize(
    ('there', 'shown'), [(True, 'imu-bench demo '), (False, 'ROS 2 is not installed here')]
)
def test_alone_it_shows_what_to_do_next(imu_bench, monkeypatch, there, shown):
    monkeypatch.setattr(entry, 'find_spec', lambda name: there or None)
    code, out, err = imu_bench()
    assert (code, err) == (2, '')
    assert shown in out
    assert max(map(len, out.splitlines())) <= 80
    for line in re.findall(r'^  imu-bench (\S.*?)(?:  |$)', out, re.MULTILINE):
        if line != '--help':
            build_parser().parse_args(line.split())


def test_quiet_writes_files_and_says_nothing(imu_bench, write_csv, tmp_path):
    result = tmp_path / 'r.json'
    assert imu_bench('analyze', write_csv(), '--json', result, '--quiet') == (0, '', '')
    assert imu_bench('compare', result, result, '-q') == (0, '', '')
    code, out, err = imu_bench('analyze', tmp_path / 'none.csv', '--quiet')
    assert (code, out) == (1, '')
    assert 'none.csv' in err


def test_quiet_prints_what_is_asked_for(imu_bench):
    assert 'static' in imu_bench('campaign', 'mast_inclination', '--list', '--quiet')[1]
    assert imu_bench('doctor', '--json', '--quiet', '--no-probe')[1].startswith('{')


def test_no_colour_where_none_is_wanted(imu_bench, write_csv, monkeypatch):
    monkeypatch.setenv('FORCE_COLOR', '1')
    path = write_csv(change=lambda rows: rows.__setitem__((50, 4), 40.0))
    assert COLOUR.search(imu_bench('analyze', path)[1])
    monkeypatch.setenv('NO_COLOR', '1')
    shown = imu_bench('analyze', path)[1]
    assert 'noise density' in shown
    assert not COLOUR.search(shown)


def test_the_man_page_is_that_of_the_parsers(reference):
    page = reference.man()
    assert reference.MAN.read_text('utf-8') == page, 'renew it with python docs/reference.py'
    for verb in verb_names():
        assert f'.SS {verb.strip("_")}\n' in page
    assert '\\fB\\-q, \\-\\-quiet\\fR' in page
