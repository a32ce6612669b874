# SPDX-License-Identifier: Apache-2.0
"""`imu-bench list`, and what the help of every verb says of names and examples."""

from pathlib import Path
import re
import shlex

from imu_bench.cli.main import build_parser, verb_names
from imu_bench.terminal.arguments import moment
import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize(
    ('kind', 'folder'),
    [('benches', 'benches'), ('sensors', 'sensors'), ('scenarios', 'scenarios')],
)
def test_files_by_their_names(imu_bench, kind, folder):
    code, out, _ = imu_bench('list', kind)
    assert code == 0
    assert set(out.split()) == {path.stem for path in (ROOT / 'config' / folder).glob('*.yaml')}


def test_everything_at_once(imu_bench):
    code, out, _ = imu_bench('list')
    assert code == 0
    found = dict(re.findall(r'^(\w+):\n((?:  .*\n)+)', out, re.MULTILINE))
    assert list(found) == [
        'benches', 'tests', 'plans', 'sensors', 'drivers', 'scenarios', 'exports',
    ]  # fmt: skip
    plans = {path.name.replace('_', '-') for path in
             (ROOT / 'imu_bench' / 'offline' / 'plans').iterdir()
             if (path / '__init__.py').is_file()}  # fmt: skip
    assert set(found['plans'].split()) == plans
    assert '  kalibr\n' in found['exports'] and '  mpu9250\n' in found['drivers']
    assert re.search(r'^  mast_inclination tilt: \S', found['tests'], re.MULTILINE)


def test_every_verb_has_two_examples_that_its_parser_takes(imu_bench):
    for name in verb_names():
        verb = name.rstrip('_')
        code, out, _ = imu_bench(verb, '--help')
        assert code == 0
        examples = re.findall(r'^  imu-bench (.*)$', out.partition('examples:')[2], re.MULTILINE)
        assert len(examples) == 2, verb
        for example in examples:
            arguments = build_parser().parse_args(shlex.split(example))
            assert arguments.run is not None


def test_times_of_analyze_are_written_as_those_of_record():
    arguments = build_parser().parse_args(
        ['analyze', 'a', '--start', '10s', '--end', '2min', '--tau', '0.1,1,5min']
    )
    assert (arguments.start, arguments.end, arguments.tau) == (10.0, 120.0, (0.1, 1.0, 300.0))
    assert moment('0') == 0.0


def test_columns_may_begin_with_one_that_is_left_out(imu_bench, tmp_path):
    rows = '\n'.join(f'7,8,{(k * 7919 % 101 - 50) / 5e4}' for k in range(500))
    (tmp_path / 'a.csv').write_text(rows)
    code, out, err = imu_bench(
        'analyze', tmp_path / 'a.csv', '--columns', '-,-,gz', '--rate', '100', '--units', 'SI'
    )
    assert (code, err) == (0, '')
    assert 'Angular velocity' in out
