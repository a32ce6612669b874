# SPDX-License-Identifier: Apache-2.0
"""Every benchmark runs to its end in its quick form; the frame of them holds what it says."""

from importlib import import_module
import json
import os
from pathlib import Path
import subprocess
import sys

import pytest

from benchmarks._frame import Benchmark

ROOT = Path(__file__).resolve().parent.parent
FILES = sorted((ROOT / 'benchmarks').glob('[a-z]*.py'))
NAMES = [
    pytest.param(
        path.stem,
        marks=[pytest.mark.ros] if 'imu_bench.nodes' in path.read_text(encoding='utf-8') else [],
    )
    for path in FILES
]


def run(name, *options):
    return subprocess.run(
        [sys.executable, '-m', f'benchmarks.{name}', *options],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip


def holds(value, target):
    """Read a target as a person would."""
    first, _, rest = target.partition(' ')
    if rest.startswith('to '):
        return float(first) <= value <= float(rest[3:])
    return {'≥': value >= float(rest), '≤': value <= float(rest), '=': value == float(rest)}[first]


@pytest.mark.slow
@pytest.mark.parametrize('name', NAMES)
def test_it_runs(name, tmp_path):
    """What a quick run measures proves nothing: its verdicts do not decide."""
    done = run(name, '--quick', '--json', str(tmp_path))
    assert done.stderr == ''
    document = json.loads((tmp_path / f'{name}.json').read_text(encoding='utf-8'))
    assert document['benchmark'] == name
    assert document['quick'] is True
    assert document['cores'] == len(os.sched_getaffinity(0))
    assert f'on {document["cores"]} cores, load average ' in done.stdout.splitlines()[0]
    assert set(document['load_average']) == {'before', 'after'}
    claims = document['claims']
    assert claims
    for claim in claims:
        assert claim['name']
        expected = 'met' if holds(float(claim['value']), claim['target']) else 'NOT MET'
        assert claim['verdict'] == expected
        assert f'| {claim["name"]} ' in done.stdout
    missed = any(claim['verdict'] == 'NOT MET' for claim in claims)
    assert done.returncode == (1 if missed else 0)


@pytest.mark.parametrize('name', NAMES)
def test_it_explains_itself(name, monkeypatch, capsys):
    monkeypatch.setattr(sys, 'argv', [f'benchmarks/{name}.py', '--help'])
    with pytest.raises(SystemExit) as ended:
        import_module(f'benchmarks.{name}').main()
    said = capsys.readouterr()
    assert (ended.value.code, said.err) == (0, '')
    assert said.out.startswith(f'usage: ./run benchmark {name} ')
    assert all(option in said.out for option in ('--quick', '--json FILE'))


@pytest.fixture
def bench(monkeypatch):
    def made(*arguments):
        monkeypatch.setattr(sys, 'argv', ['benchmarks/mine.py', *arguments])
        return Benchmark('Mine.')

    return made


@pytest.mark.parametrize(
    ('value', 'target', 'code'),
    [
        (15.0, {'at_least': 15.0}, 0),
        (14.9, {'at_least': 15.0}, 1),
        (0.3, {'at_most': 0.3}, 0),
        (0.31, {'at_most': 0.3}, 1),
        (0.94, {'at_least': 0.93, 'at_most': 0.97}, 0),
        (0.92, {'at_least': 0.93, 'at_most': 0.97}, 1),
        (0, {'at_least': 0, 'at_most': 0}, 0),
        (float('nan'), {'at_most': 0.3}, 1),
        (float('inf'), {'at_most': 0.3}, 1),
        (float('inf'), {'at_least': 0.3}, 0),
    ],
)
def test_one_claim_that_is_not_met_is_exit_code_1(bench, tmp_path, capsys, value, target, code):
    path = tmp_path / 'mine.json'
    mine = bench('--json', str(path))
    mine.start()
    mine.claim('kept', 1.0, at_least=1.0)
    mine.claim('tried', value, **target, unit='s')
    assert mine.done() == code
    kept, tried = json.loads(path.read_text(encoding='utf-8'))['claims']
    assert kept['verdict'] == 'met'
    assert tried['verdict'] == ('NOT MET' if code else 'met')
    [line] = [text for text in capsys.readouterr().out.splitlines() if '| tried ' in text]
    assert f'| {tried["verdict"]} ' in line
    assert f'| {tried["target"]} ' in line


def test_sizes_are_small_in_a_quick_run_and_as_told(bench):
    def runs(*arguments):
        mine = bench(*arguments)
        mine.add_size('--runs', 200, quick=5, help='records')
        return mine.start().runs

    assert (runs(), runs('--quick'), runs('--quick', '--runs', '7')) == (200, 5, 7)
    with pytest.raises(SystemExit):
        runs('--runs', '0')


def test_a_benchmark_without_a_claim_or_a_target_is_a_mistake(bench):
    mine = bench()
    mine.start()
    with pytest.raises(ValueError, match='mine claims nothing'):
        mine.done()
    with pytest.raises(ValueError, match="'aimless' needs a target"):
        mine.claim('aimless', 1.0)
