# SPDX-License-Identifier: Apache-2.0
"""`imu-bench campaign`: runs, results, the page that leads to them, and bad input in one line."""

import json
import re

import pytest

BENCH = """\
name: one
title: One inclinometer
sensors:
  - file: scl3300
tests:
  - name: rest
    title: At rest <b>
    scenarios: [still]
    duration: "1 h"
    plan: static
    settings: {bandwidth: 100 Hz}
    short: {duration: "20 s", repetitions: 2}
  - name: night
    scenarios: [still]
    duration: "14 h"
    on_request: true
"""


@pytest.fixture
def bench(tmp_path):
    """Return the file of a bench with two tests."""
    path = tmp_path / 'bench.yaml'
    path.write_text(BENCH, encoding='utf-8')
    return path


def test_runs_are_simulated_analysed_and_led_to(imu_bench, bench, tmp_path):
    folder = tmp_path / 'campaign'
    code, out, err = imu_bench('campaign', bench, '--short', '--jobs', '1', '-o', folder)
    assert (code, err) == (0, '')
    assert sorted(path.name for path in folder.iterdir()) == ['index.html', 'rest']
    runs = sorted(path.name for path in (folder / 'rest').iterdir() if path.is_dir())
    assert runs == ['still_1', 'still_2']
    found = json.loads((folder / 'rest/results.json').read_text(encoding='utf-8'))
    assert found['settings']['bandwidth'] == {'value': 100.0, 'unit': 'Hz'}
    assert len(found['sources']) == 2
    page = (folder / 'index.html').read_text(encoding='utf-8')
    assert 'href="rest/report.html"' in page
    assert 'At rest &lt;b&gt;' in page
    form = 'a run of 20 s instead of 3600 s; repetitions 2 instead of 1'
    assert f'  short form: {form}\n' in out
    assert 'In a short form, and not as the document has it: At rest' in page
    for text in (page, (folder / 'rest/report.html').read_text(encoding='utf-8')):
        assert f'<b>Short form:</b> {form}.' in text
        assert 'After Shabulinzenze, Comparison of MEMS sensors in machine vibration' in text
        assert '2 streams of 2 recordings, from 20' in text
        assert 'health: good.' in text
    assert out.splitlines()[-1] == f'wrote {folder}/index.html'


def test_a_run_that_is_there_is_not_simulated_again(imu_bench, bench, tmp_path):
    folder = tmp_path / 'campaign'
    imu_bench('campaign', bench, '--short', '--jobs', '1', '-o', folder)
    before = {path: path.stat().st_mtime_ns for path in folder.glob('rest/*/*.mcap')}
    code, _, _ = imu_bench('campaign', bench, '--short', '--jobs', '1', '--recorded', '-o', folder)
    assert code == 0
    assert before == {path: path.stat().st_mtime_ns for path in folder.glob('rest/*/*.mcap')}
    assert len(before) == 2


@pytest.mark.parametrize(
    ('line', 'option', 'kinds'),
    [
        ('', (), {'.mcap'}),
        ('    storage: npy\n', (), {'.npy'}),
        ('    storage: npy\n', ('--storage', 'sqlite3'), {'.db3'}),
        ('', ('--storage', 'npy'), {'.npy'}),
    ],
)
def test_format_of_the_runs(imu_bench, bench, tmp_path, line, option, kinds):
    text = bench.read_text(encoding='utf-8')
    bench.write_text(text.replace('    plan: static\n', f'    plan: static\n{line}'), 'utf-8')
    folder = tmp_path / 'campaign'
    code, _, err = imu_bench('campaign', bench, '--short', '--jobs', '1', *option, '-o', folder)
    assert (code, err) == (0, '')
    files = [path.suffix for path in (folder / 'rest/still_1').rglob('*') if path.is_file()]
    assert set(files) - {'.json', '.yaml'} == kinds


def test_an_unknown_format_is_refused(imu_bench, bench, tmp_path):
    bench.write_text(bench.read_text(encoding='utf-8') + '    storage: hdf5\n', 'utf-8')
    code, _, err = imu_bench('campaign', bench, '-o', tmp_path / 'campaign')
    assert code == 1
    assert 'tests[1].storage: hdf5 is not allowed; allowed: mcap, sqlite3, npy' in err


def test_repetitions_differ(imu_bench, bench, tmp_path):
    folder = tmp_path / 'campaign'
    imu_bench('campaign', bench, '--short', '--jobs', '1', '-o', folder)
    one, two = (path.read_bytes() for path in sorted(folder.glob('rest/*/*.mcap')))
    assert one != two


def test_more_runs_once_along_every_axis(imu_bench, tmp_path):
    code, out, _ = imu_bench('campaign', 'vehicle_vibration', '--list', '-o', tmp_path)
    assert code == 0
    names = [line.rpartition('/')[2] for line in out.splitlines() if '/sine_on_random_sc' in line]
    assert len(names) == 4 * 3 * 5 + 3 * 3
    assert names[-9:] == [
        f'sine_on_random_sc{condition}_{axis}_sine' for condition in (1, 2, 3) for axis in 'xyz'
    ]


def test_the_sine_alone_tells_what_random_vibration_costs(imu_bench, tmp_path):
    """The bench as it is, but one condition along one axis and zones of some seconds."""
    from imu_bench.config.location import config_file
    import yaml

    file = config_file('benches/vehicle_vibration.yaml')
    document = yaml.safe_load(file.read_text(encoding='utf-8'))
    document['sensors'] = document['sensors'][:1]
    (test,) = (each for each in document['tests'] if each['name'] == 'sine_on_random')
    document['tests'] = [test]
    test |= {'scenarios': ['sine_on_random_sc2'], 'axes': ['y'], 'repetitions': 1}
    test['set'] = ['zones.before=9 s', 'zones.test=15 s', 'zones.after=9 s']
    test['also']['scenarios'] = test['scenarios']
    bench = tmp_path / 'small.yaml'
    bench.write_text(yaml.safe_dump(document, allow_unicode=True), encoding='utf-8')
    code, out, _ = imu_bench('campaign', bench, '--jobs', '1', '-o', tmp_path / 'c')
    assert code == 0
    found = json.loads((tmp_path / 'c/sine_on_random/results.json').read_text(encoding='utf-8'))
    assert not any(finding['code'] == 'no-reference' for finding in found['findings'])
    assert re.search(r'Random vibration costs up to [1-9][\d.]* ± ?[\d.]+ dB of SNR', out)


def test_the_list_names_folders_and_what_is_left_out(imu_bench, bench):
    code, out, err = imu_bench('campaign', bench, '--list')
    assert code == 0
    assert re.search(r'DIR/rest/still$', out, re.MULTILINE)
    assert 'night' not in out
    assert err == 'only with --test: night\n'


@pytest.mark.parametrize(
    ('arguments', 'text'),
    [
        (('--test', 'ride'), '--test ride: bench one has: rest, night'),
        ((), 'where to? Name a folder with -o DIR'),
    ],
)
def test_bad_input_is_one_line(imu_bench, bench, arguments, text):
    code, _, err = imu_bench('campaign', bench, *arguments)
    assert code == 1
    assert err == f'imu-bench: error: {text}\n'


def test_missing_recordings_are_named_and_the_page_says_so(imu_bench, bench, tmp_path):
    folder = tmp_path / 'campaign'
    code, _, err = imu_bench('campaign', bench, '--recorded', '-o', folder)
    assert code == 1
    assert 'test rest: 1 of 1 runs are missing' in err
    assert 'runs are missing' in (folder / 'index.html').read_text(encoding='utf-8')


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (('plan: static', 'plan: stetic'), 'did you mean static?'),
        (('bandwidth: 100 Hz', 'band: 100 Hz'), '--set band: plan static has no such setting'),
        (('scenarios: [still]', 'scenarios: [stil]'), "'stil'"),
    ],
)
def test_a_test_that_cannot_run_is_one_line(imu_bench, bench, tmp_path, change, text):
    bench.write_text(bench.read_text(encoding='utf-8').replace(*change), encoding='utf-8')
    code, _, err = imu_bench('campaign', bench, '--short', '-o', tmp_path / 'c')
    assert code == 1
    assert len(err.splitlines()) == 1
    assert text in err


@pytest.mark.parametrize(
    ('change', 'text'),
    [
        (('repetitions: 2', 'repetitions: 0'), 'tests[0].short.repetitions: 0 is not allowed'),
        (('name: night', 'name: rest'), "tests: 'rest' is there twice"),
        (('on_request: true', 'on_demand: true'), 'tests[1].on_demand: unknown'),
        (('on_request: true', 'also: {set: [a=1]}'), 'tests[1].also.name: '),
        (('on_request: true', 'live: {time: 1 s}'), 'tests[1].live.time: unknown'),
        (('title: One incl', 'demo: sleep\ntitle: Incl'), "demo: 'sleep' is none of the tests"),
        (('duration: "1 h"', 'duration: 1'), 'tests[0].duration: '),
    ],
)
def test_a_bench_with_a_wrong_test_is_refused(imu_bench, bench, tmp_path, change, text):
    bench.write_text(bench.read_text(encoding='utf-8').replace(*change), encoding='utf-8')
    code, _, err = imu_bench('campaign', bench, '-o', tmp_path / 'c')
    assert code == 1
    assert text in err
