# SPDX-License-Identifier: Apache-2.0
"""`imu-bench analyze` on many recordings: side by side, on a cluster, stopped and begun again."""

from argparse import Namespace
import json
import multiprocessing
import os
from pathlib import Path
import shutil
import signal
import subprocess
import sys
import time

from distributed import LocalCluster
from imu_bench.offline.analysis.settings import Settings
from imu_bench.offline.recordings import ReadOptions
from imu_bench.offline.running import workers
from imu_bench.offline.running.pipeline import analyse_files, Order
from imu_bench.offline.running.workers import Processes
from imu_bench.terminal import working
import pytest

MANY = 16
"""Recordings from which several processes share the work, whatever their size."""


@pytest.fixture(scope='module')
def folder(write_csv, tmp_path_factory):
    """Return a folder of recordings, one of them damaged."""
    found = tmp_path_factory.mktemp('many')
    for seed in range(MANY):
        shutil.copy(write_csv(f'{seed}.csv', seed=seed, n=500), found / f'chip_{seed:02}.csv')
    (found / 'bad.csv').write_text('stamp_s,linear_acceleration.x\n1,a\n2,b\n', encoding='utf-8')
    return found


COMMAND = [sys.executable, '-m', 'imu_bench.cli.main', 'analyze']


def found(path):
    """Return a document but for the command, which names the number of processes."""
    document = json.loads(path.read_text())
    assert document['settings'].pop('command')
    return document


def analyse(inputs, output, *options):
    """
    Return exit code, error lines and the document.

    In a process of its own: here the linear algebra library has several threads already.
    """
    done = subprocess.run(
        [*COMMAND, *map(str, inputs), '--json', str(output), *options],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    return done.returncode, done.stderr.splitlines(), found(output)


@pytest.fixture(scope='module')
def recordings(folder):
    return sorted(folder.glob('*.csv'))


@pytest.fixture(scope='module')
def alone(recordings, tmp_path_factory):
    """Return what one process makes of the recordings."""
    return analyse(recordings, tmp_path_factory.mktemp('alone') / '1.json', '--jobs', '1')


@pytest.mark.slow
def test_processes_change_nothing_and_a_bad_file_stops_nobody(recordings, alone, tmp_path):
    shared = analyse(recordings, tmp_path / '3.json', '--jobs', '3')
    assert alone == shared
    code, errors, document = shared
    assert code == 1
    assert len(errors) == 1
    assert 'bad.csv' in errors[0]
    assert [Path(r['source']).name for r in document['recordings']] == [
        path.name for path in recordings if path.name != 'bad.csv'
    ]
    assert [Path(failure['source']).name for failure in document['failures']] == ['bad.csv']


@pytest.mark.slow
def test_axes_of_one_large_recording_are_shared_out(write_csv, tmp_path):
    large = write_csv('large.csv', n=150_000)
    assert large.stat().st_size > 8 << 20
    alone = analyse([large], tmp_path / '1.json', '--jobs', '1')
    assert alone == analyse([large], tmp_path / '2.json', '--jobs', '2')
    assert alone[0] == 0


@pytest.mark.slow
@pytest.mark.filterwarnings('ignore::DeprecationWarning', 'ignore::ResourceWarning')
def test_a_dask_cluster_gives_the_same(recordings, alone, tmp_path):
    folder = tmp_path / 'dask'
    with LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, local_directory=folder
    ) as cluster:
        there = ('--scheduler', cluster.scheduler_address)
        shared = analyse(recordings, tmp_path / 'cluster.json', *there)
        one = analyse(recordings[1:2], tmp_path / 'one.json', *there)
    assert shared == alone
    assert one[2]['recordings'] == [alone[2]['recordings'][0]]


@pytest.mark.slow
@pytest.mark.filterwarnings('ignore::DeprecationWarning', 'ignore::ResourceWarning')
def test_no_cluster_where_none_is(imu_bench, recordings, monkeypatch):
    monkeypatch.setattr('imu_bench.offline.running.workers._PATIENCE_S', 1)
    code, _, err = imu_bench('analyze', *recordings, '--scheduler', 'tcp://127.0.0.1:1')
    assert code == 1
    assert 'tcp://127.0.0.1:1: no scheduler there' in err
    assert 'Traceback' not in err


@pytest.mark.slow
def test_a_killed_run_goes_on_where_it_was(recordings, alone, tmp_path):
    again = tmp_path / 'again.json'
    environment = {**os.environ, 'TMPDIR': str(tmp_path)}

    def run(output, **options):
        inputs = map(str, recordings)
        return subprocess.Popen(
            [*COMMAND, *inputs, '--json', str(output), '--jobs', '2'], env=environment,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options,
        )  # fmt: skip

    kept = tmp_path / 'imu_bench_cache' / 'results'
    assert not kept.exists()
    with run(again, start_new_session=True) as process:
        deadline = time.monotonic() + 300
        while len(list(kept.glob('*.result'))) < 3 and time.monotonic() < deadline:
            assert process.poll() is None, 'it was finished before it could be killed'
        process.kill()
        process.communicate()
    assert process.returncode == -signal.SIGKILL
    assert not again.exists()
    before = len(list(kept.glob('*.result')))
    assert before >= 3
    with run(again) as process:
        out, _ = process.communicate()
    said = next(line for line in out.splitlines() if 'finished by an earlier run' in line)
    assert before <= int(said.split()[0]) <= MANY
    assert found(again) == alone[2]
    assert not kept.exists()


@pytest.mark.slow
def test_a_killed_process_takes_no_recording_along(recordings):
    before, found = set(multiprocessing.active_children()), {}
    order = Order(ReadOptions(), Settings())
    with Processes(2) as workers:

        def told(number, outcome):
            if not found:
                mine = set(multiprocessing.active_children()) - before
                os.kill(mine.pop().pid, signal.SIGKILL)
            found[number] = outcome

        analyse_files(recordings, order, workers, told)
    failed = [recordings[number].name for number, o in found.items() if o.failures]
    assert sorted(found) == list(range(len(recordings)))
    assert failed == ['bad.csv']


def test_more_processes_than_memory_allows_are_told_and_not_started(write_csv, capsys):
    arguments = Namespace(jobs=16, scheduler=None)
    with working.workers(arguments, [write_csv(n=10)] * 20) as team:
        assert team.jobs == workers.MOST_WITHIN_MEMORY < 16
    told = capsys.readouterr().err
    assert told == (
        '--jobs 16: 10 processes do the work, more would take over 1 GB of memory together\n'
    )
