# SPDX-License-Identifier: Apache-2.0
"""The terminal table fits every width and prints nothing that steers a terminal."""

from dataclasses import replace
import io

from imu_bench.cli import table
from imu_bench.offline import results
from imu_bench.offline.comparison import compare
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
    assert text.count('lsm303dlhc ') >= 3  # its heading, and a row in each table
    assert 'σ, RMS  ' not in text  # one number a line
