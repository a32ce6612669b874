# SPDX-License-Identifier: Apache-2.0
"""`analyze --pool`: recordings of one sensor become one sensor, which holds them as its runs."""

from dataclasses import replace
import json
from pathlib import Path

from imu_bench.bags.problems import SIMULATED
from imu_bench.cli.main import main
from imu_bench.offline.analysis.results import read
from imu_bench.offline.comparing.pooling import pool, pool_known
from imu_bench.offline.health.finding import Finding
import numpy as np
import pytest

from benchmarks._analyzed import analyzed, AXIS
from benchmarks._misfit import markov, RATE_HZ, SCENARIOS, walk, WHITE, white

HEADER = 'stamp_s,angular_velocity.x,angular_velocity.y,angular_velocity.z\n'
N = 1e-3


@pytest.fixture
def runs(tmp_path):
    """Return three recordings of one sensor of a minute, one of them twice as noisy in z."""
    paths = []
    for number in range(3):
        rng = np.random.default_rng([50, number])
        rates = rng.normal(0.0, N * 10.0, (6000, 3))
        rates[:, 2] *= 2.0 if number == 1 else 1.0
        stamps = np.arange(6000) / 100.0
        path = tmp_path / f'run{number}.csv'
        rows = np.column_stack([stamps, rates])
        path.write_text(HEADER + '\n'.join(','.join(f'{v:.9g}' for v in r) for r in rows) + '\n')
        paths.append(str(path))
    return paths


@pytest.mark.slow
def test_many_recordings_are_one_sensor(runs, tmp_path, capsys):
    out, page = tmp_path / 'r.json', tmp_path / 'r.html'
    assert main(['analyze', *runs, '--pool', '--json', str(out), '--html', str(page)]) == 0
    document = json.loads(out.read_text(encoding='utf-8'))
    (pooled,) = document['recordings']
    alone = pooled['runs']
    assert len(alone) == 3 and pooled['source'] == '3 recordings' and pooled['topic'] == 'run'
    assert pooled['health']['samples'] == 18_000
    x, z = (pooled['axes'][f'angular_velocity.{axis}'] for axis in 'xz')
    assert x['coefficients']['N']['low'] < N < x['coefficients']['N']['high']
    widths = [r['axes']['angular_velocity.x']['coefficients']['N'] for r in alone]
    mean_width = np.mean([w['high'] - w['low'] for w in widths])
    assert x['coefficients']['N']['high'] - x['coefficients']['N']['low'] < 0.8 * mean_width
    assert x['between_recordings']['N']['recordings'] == 3
    assert z['between_recordings']['N']['excess']['low'] > 1.0
    codes = {f['code']: f['text'] for f in pooled['health']['findings']}
    assert 'N of angular_velocity.z' in codes['recordings_differ']
    assert '.x' not in codes['recordings_differ']
    assert document['comparison']['labels'] == ['run']
    assert document['settings']['pool'] is True
    said = capsys.readouterr().out
    assert '1 sensor in 3 runs, 3 min' in said and 'Dead reckoning: run, ' in said
    assert [run.source for run in read(out).recordings[0].runs] == runs
    text = page.read_text(encoding='utf-8')
    assert text.count('<summary class="row">') == 3
    assert 'From run to run: 3 runs' in text and 'noise by run' in text


@pytest.mark.slow
def test_turn_on_bias_is_the_scatter_of_the_means(runs, tmp_path):
    """The files are read here with NumPy alone."""
    out = tmp_path / 'r.json'
    assert main(['analyze', *runs, '--pool', '--json', str(out)]) == 0
    means = [np.loadtxt(run, delimiter=',', skiprows=1)[:, 1].mean() for run in runs]
    axis = read(out).recordings[0].axes['angular_velocity.x']
    assert axis.between['mean'].std.value == pytest.approx(np.std(means, ddof=1), rel=1e-6)


@pytest.mark.slow
def test_a_finding_of_many_runs_is_one_note(runs, tmp_path):
    """Two of three runs lack a second; each says so itself, and the sensor once."""
    for path in runs[:2]:
        lines = Path(path).read_text(encoding='utf-8').splitlines(keepends=True)
        Path(path).write_text(''.join(lines[:3000] + lines[3100:]), encoding='utf-8')
    out = tmp_path / 'r.json'
    assert main(['analyze', *runs, '--pool', '--json', str(out)]) == 0
    (pooled,) = read(out).recordings
    (gap,) = [f for f in pooled.health.findings if f.code == 'gaps']
    assert gap.text.startswith('2 of 3 runs (run0, run1)')
    assert pooled.health.missing == 200


@pytest.mark.slow
def test_serial_numbers_tell_sensors_of_one_topic_apart(runs, tmp_path):
    out = tmp_path / 'r.json'
    assert main(['analyze', *runs, '--json', str(out)]) == 0
    results = [replace(one, topic='/imu') for one in read(out).recordings]
    (one,) = pool(results, 0.95)
    assert len(one.runs) == 3
    second, first, again = (
        replace(result, serial=serial) for result, serial in zip(results, 'BAA', strict=True)
    )
    alone, pair = pool([second, first, again], 0.95)
    assert alone is second and pair.serial == 'A' and len(pair.runs) == 2


@pytest.mark.slow
def test_recordings_of_one_serial_number_need_not_be_asked_for(runs, tmp_path):
    out = tmp_path / 'r.json'
    assert main(['analyze', *runs, '--json', str(out)]) == 0
    found = read(out).recordings
    assert len(found) == 3
    rows = [replace(one, topic='/imu', serial='A', start_ns=n * 100, end_ns=n * 100 + 99)
            for n, one in enumerate(found)]  # fmt: skip
    (sensor,) = pool_known(rows, 0.95)
    assert len(sensor.runs) == 3
    unknown = [replace(one, serial='') for one in rows]
    assert pool_known(unknown, 0.95) == unknown
    note = Finding('warning', SIMULATED, 'emulated', '', '')
    emulated = replace(rows[0], health=replace(rows[0].health, findings=(note,)))
    assert pool_known([emulated, rows[1]], 0.95) == [emulated, rows[1]]


@pytest.mark.slow
def test_what_cannot_be_pooled_stays_apart_and_says_why(runs, tmp_path, capsys):
    """One of the recordings is of half the rate."""
    lines = Path(runs[1]).read_text(encoding='utf-8').splitlines(keepends=True)
    Path(runs[1]).write_text(HEADER + ''.join(lines[1::2]), encoding='utf-8')
    out = tmp_path / 'r.json'
    assert main(['analyze', *runs[:2], '--json', str(out)]) == 0
    found = [replace(one, topic='/imu', serial='A', start_ns=n * 100, end_ns=n * 100 + 99)
             for n, one in enumerate(read(out).recordings)]  # fmt: skip
    for one in pool_known(found, 0.95):
        assert not one.runs
        (said,) = [f.text for f in one.health.findings if f.code == 'not_pooled']
        assert 'serial number A' in said and '100, 50 Hz' in said
    assert main(['analyze', *runs[:2], '--pool']) == 1
    assert '--pool: ' in capsys.readouterr().err


def test_what_belongs_together_must_be_clear(runs, capsys):
    assert main(['analyze', runs[0], '--pool']) == 1
    assert 'two recordings of a sensor or more' in capsys.readouterr().err


@pytest.mark.parametrize('name', ['step', 'AR(1) 0.9', 'resonant filter', 'white, random walk'])
def test_a_pool_claims_nothing_that_its_recordings_refuse(name):
    """The pooled curve claimed K of steps, Q of ringing, and four times the N of AR(1)."""
    found, n = [], 60_000
    for seed in range(3):
        x = SCENARIOS[name].make(n, np.random.default_rng([seed, 600]))
        stamps = (seed * 10**13 + np.arange(n) * round(1e9 / RATE_HZ)).astype(np.int64)
        result = analyzed(3.0 * x if name == 'step' else x, RATE_HZ, None, stamps)
        found.append(replace(result, source=f'{seed}.bag'))
    (one,) = pool(found, 0.95)
    model = one.axes[AXIS].model
    truth = 3.0 * WHITE if name == 'step' else WHITE
    assert model.N.low < truth < model.N.high
    refused = name != 'white, random walk'
    assert any('recordings the' in flag for flag in model.flags) == refused
    if refused:
        assert not any(model.coefficients[term].observable for term in 'QBKR')


@pytest.mark.parametrize('is_walk', [True, False])
def test_a_pool_tells_a_random_walk_from_a_process_or_says_that_it_does_not(is_walk):
    """Of ten minutes with a correlation time of 100 s K was claimed without a word."""
    found, n = [], 60_000
    for seed in range(4):
        rng = np.random.default_rng([900, 4, seed])
        slow = walk(n, rng, 2e-5) if is_walk else markov(n, rng, 5e-5, 100.0)
        stamps = (seed * 10**13 + np.arange(n) * round(1e9 / RATE_HZ)).astype(np.int64)
        result = analyzed(white(n, rng) + slow, RATE_HZ, None, stamps)
        found.append(replace(result, source=f'{seed}.bag'))
    (one,) = pool(found, 0.95)
    model = one.axes[AXIS].model
    if is_walk:
        assert model.K.low < 2e-5 < model.K.high
    said = any(flag.startswith('K is not told from') for flag in model.flags)
    assert said != is_walk
