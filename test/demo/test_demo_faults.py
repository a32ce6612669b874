# SPDX-License-Identifier: Apache-2.0
"""`imu-bench demo --faults` as a user runs it: two sensors, four faults, each recovered from."""

import json
from pathlib import Path
import re
import subprocess
import sys

import pytest
import yaml

pytestmark = [pytest.mark.ros, pytest.mark.slow]

SENSORS = Path(__file__).resolve().parents[2] / 'config' / 'sensors'
FAULTS = {
    'mpu9250': ['unplugged 9 1', 'stall 14 0.3'],
    'scl3300': ['bit_errors 10 0.5', 'brown_out 15'],
}


def run_demo(folder, faults, *arguments):
    """Write a bench with these faults; return what the demo says of it."""
    entries = [
        {'file': str(SENSORS / f'{name}.yaml'), 'overrides': {'simulation': {'faults': script}}}
        for name, script in faults.items()
    ]
    path = folder / 'my_bench.yaml'
    path.write_text(yaml.safe_dump({'name': 'mine', 'sensors': entries}), encoding='utf-8')
    command = [sys.executable, '-m', 'imu_bench.cli.main', 'demo', '--faults', str(path)]
    return subprocess.run(
        [*command, '-o', str(folder / 'run'), *arguments],
        capture_output=True, text=True,
    )  # fmt: skip


def test_each_fault_is_told_live_recovered_from_and_in_the_report(tmp_path):
    import rosbags  # noqa: F401, without it nothing is recorded

    result = run_demo(tmp_path, FAULTS)
    # a machine that is too busy to empty a FIFO in time loses more, and the demo says so
    complaint = 'imu-bench: error: ' in result.stderr
    assert result.returncode == complaint, result.stdout + result.stderr
    assert 'on the way' not in result.stdout, result.stdout
    assert '4 of 4 faults recovered from, ' in result.stdout
    assert result.stdout.count(' samples lost to the scripted faults, ') == 2
    for words in (
        'unplugged +begins, for 1 s',
        'unplugged +NoAnswer: emulated mpu9250 on i2c: nothing answers; check power',
        r'unplugged +over: data again after \d\.\d\d s, [\d\u202f]+ samples lost',
        r'stall .*fifo_overflows 1',
        'bit_errors +ChecksumError: emulated scl3300 on frame: ',
        r'brown_out +over: .*brown_outs 1',
    ):
        assert re.search(words, result.stderr), (words, result.stderr)
    # counted as lost and missing in the recording are the same samples
    document = json.loads((tmp_path / 'run' / 'results.json').read_text(encoding='utf-8'))
    missing = {e['topic'].split('/')[2]: e['health']['missing'] for e in document['recordings']}
    made = {e['topic'].split('/')[2]: e['health']['samples'] for e in document['recordings']}
    for name in FAULTS:
        lost, otherwise, seen = re.search(
            rf'{name}: (\d+) lost by faults(?: and (\d+) otherwise)?; (\d+) missing',
            result.stdout,
        ).groups(default='0')
        assert int(seen) == missing[name]
        assert int(lost) > 20
        # a few at the ends of the faults, and what docs/recording.md says of a machine too busy
        assert int(seen) == pytest.approx(int(lost) + int(otherwise), abs=4 + 4e-3 * made[name])
    assert 'missing' in (tmp_path / 'run' / 'report.html').read_text(encoding='utf-8')


def test_a_fault_that_was_not_played_is_no_success(tmp_path):
    import rosbags  # noqa: F401, without it nothing is recorded

    result = run_demo(tmp_path, {'scl3300': ['unplugged 3000 1']}, '--duration', '2')
    assert result.returncode == 1
    assert 'was not played; give a longer --duration' in result.stdout


def test_a_bench_without_faults_says_how_to_give_some(tmp_path):
    result = run_demo(tmp_path, {'scl3300': []})
    assert result.returncode == 1
    assert 'no fault is scripted in this bench; give simulation.faults' in result.stderr
    assert result.stderr.count('\n') == 1
