# SPDX-License-Identifier: Apache-2.0
"""The terminal table fits every width and prints nothing that steers a terminal."""

from dataclasses import replace
import fcntl
import io
import os
import struct
import sys
import termios

from imu_bench.offline.analysis import results
from imu_bench.offline.comparing.sensors import compare
from imu_bench.offline.health import Finding
from imu_bench.offline.plans.result import PlanResult
from imu_bench.offline.presentation.tables import Column, Table
from imu_bench.terminal import tables as table
import pytest
from rich.console import Console


@pytest.fixture(scope='module')
def analysis(write_csv, tmp_path_factory):
    from imu_bench.cli.main import main

    document = tmp_path_factory.mktemp('table') / 'r.json'
    assert main(['analyze', str(write_csv(n=20_000)), '--json', str(document)]) == 0
    return results.read(document)


def shown(analysis, width, **options):
    out = io.StringIO()
    console = Console(file=out, width=width, highlight=False)
    table.show(analysis, compare(analysis.recordings), console, **options)
    return out.getvalue()


@pytest.mark.parametrize('width', [40, 60, 80, 100, 120, 200])
def test_fits_every_width(analysis, width):
    text = shown(analysis, width)
    assert max(map(len, text.splitlines())) <= width
    for letter in 'xyz':
        assert f' {letter}' in text
    assert 'density' in text
    assert '…' not in text


def test_wide_output_has_uncertainties(analysis):
    assert '±' in shown(analysis, 200)
    assert '\x1b' not in shown(analysis, 200)


def test_names_from_a_recording_cannot_steer_the_terminal(analysis):
    evil = replace(
        analysis.recordings[0], topic='/\x1b[2J[red]boo[/red]', source='a\nb\x07[bold].csv'
    )
    text = shown(replace(analysis, recordings=(evil,)), 120)
    assert '\x1b' not in text
    assert '\x07' not in text
    assert '[red]boo[/red]' in text


def test_six_sensors_are_a_table_at_80_columns(analysis):
    """The mean of one sensor may be far smaller than that of the others."""
    one = analysis.recordings[0]
    level = replace(one.axes['linear_acceleration.z'].statistics['mean'], value=6e-8)
    axes = {
        name: replace(axis, statistics={**axis.statistics, 'mean': level})
        if axis.quantity == 'linear_acceleration'
        else axis
        for name, axis in one.axes.items()
    }
    recordings = tuple(
        replace(one, topic=f'/bench/{name}/imu/data_raw', axes=axes)
        for name in ('mti300', 'mpu9250', 'lsm303dlhc')
    )
    text = shown(replace(analysis, recordings=recordings), 80)
    assert text.count('lsm303dlhc ') >= 6  # its heading, a row in each table, its four numbers
    assert '  σ, RMS' in text  # columns, not one number a line
    assert text.count('±') > 18 * 2  # and each with its interval


def moved(label):
    return Finding('severe', 'motion', f'{label} moved.', 'It affects all.', 'Record again.')


def test_the_summary_is_last_and_what_several_share_is_said_once(analysis):
    one = analysis.recordings[0]
    note = Finding('info', 'tones', 'A tone of 50 Hz.', 'Little.', 'None.')
    many = replace(
        analysis,
        recordings=tuple(
            replace(one, topic=f'/bench/{name}/imu/data_raw',
                    health=replace(one.health, findings=(moved(name), note)))
            for name in 'abcdef'
        ),
    )  # fmt: skip
    text = ' '.join(shown(many, 100).split())
    assert text.count('It affects all. Record again.') == 1
    assert 'a: a moved. b: b moved. c: c moved. Likewise d, e, f.' in text
    assert 'A tone of 50 Hz.' not in text
    assert '6 notes without effect on the numbers: --full' in text
    assert text.index('Which sensor is best') > text.index('Numbers for your filter')
    full = ' '.join(shown(many, 100, full=True).split())
    assert full.count('It affects all. Record again.') == 6
    assert full.count('A tone of 50 Hz.') == 6


def test_a_plan_shows_a_dozen_rows_and_the_columns_that_fit(analysis):
    columns = (Column('Sensor'), *(Column(f'column number {n}') for n in range(8)))
    rows = tuple((f'row {n}', *('0.1 ± 0.2',) * 8) for n in range(207))
    plan = PlanResult(
        plan='p', title='T', sources=(), settings={}, summary=('It is so.',), findings=(),
        tables=(Table('Many', columns, rows),), figures=(), failures=(),
    )  # fmt: skip

    def printed(**options):
        out = io.StringIO()
        table.show_plan(plan, Console(file=out, width=80, highlight=False), **options)
        return out.getvalue()

    text = printed()
    assert len(text.splitlines()) < 30 and max(map(len, text.splitlines())) <= 80
    assert 'row 11' in text and 'row 12' not in text
    assert 'and 195 rows more: --full' in text
    assert 'columns without room: --full' in text
    assert text.rstrip().endswith('It is so.')
    assert 'row 206' in printed(full=True)


def test_the_width_is_that_of_the_terminal_behind_a_pipe(monkeypatch):
    monkeypatch.setenv('COLUMNS', '93')
    assert table.console().width == 93
    monkeypatch.delenv('COLUMNS')
    main, behind = os.openpty()
    with os.fdopen(behind, 'w') as stderr, open(os.devnull, 'w') as null:
        # tcsetwinsize is of Python 3.11
        fcntl.ioctl(main, termios.TIOCSWINSZ, struct.pack('HHHH', 24, 71, 0, 0))
        for name, stream in (('stdout', null), ('stderr', stderr), ('stdin', null)):
            monkeypatch.setattr(sys, f'__{name}__', stream)
        assert table.console().width == 71
        monkeypatch.setattr(sys, '__stderr__', null)
        assert table.console().width == table.FILE_WIDTH
    os.close(main)
