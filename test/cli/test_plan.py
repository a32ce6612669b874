# SPDX-License-Identifier: Apache-2.0
"""`imu-bench analyze --plan`: what it prints and writes, and bad input in one line."""

import json

import pytest


def test_static_in_the_terminal_and_in_files(imu_bench, write_csv, tmp_path):
    document, page, figures = tmp_path / 'p.json', tmp_path / 'p.html', tmp_path / 'figures'
    code, out, err = imu_bench(
        'analyze', '--plan', 'static', write_csv(), '--json', document, '--html', page,
        '--figures', figures,
    )  # fmt: skip
    assert (code, err) == (0, '')
    assert out.index('Static comparison') < out.index('stationary data (table 5.1)')
    found = json.loads(document.read_text(encoding='utf-8'))
    assert found['schema'] == 'imu_bench.plan/1'
    assert found['plan'] == 'static'
    assert 'table 5.2' in page.read_text(encoding='utf-8')
    assert list(figures.glob('*.svg'))


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (('--plan', 'statics'), '--plan statics: did you mean static?'),
        (('--plan', 'static', '--set', 'x'), '--set x: write it as NAME=VALUE'),
        (('--plan', 'static', '--set', 'x=1'), 'plan static has no such setting'),
        (('--plan', 'static', '--set', 'bandwidth=1 m'), "'m'"),
        (('--plan', 'static', '--reference', 'me'), '--reference me: not among the sensors'),
    ],
)
def test_bad_input_is_one_line(imu_bench, write_csv, arguments, text):
    code, _, err = imu_bench('analyze', *arguments, write_csv())
    assert code == 1
    assert len(err.splitlines()) == 1
    assert text in err


def test_a_recording_that_fails_is_one_line(imu_bench, write_csv):
    code, _, err = imu_bench('analyze', '--plan', 'inclination', write_csv())
    assert code == 1
    assert len(err.splitlines()) == 1
