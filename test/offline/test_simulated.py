# SPDX-License-Identifier: Apache-2.0
"""Nothing that comes out of simulated data can be taken for the numbers of a sensor."""

from contextlib import redirect_stdout
import io
import json
import re
import shutil

from imu_bench.cli.main import main
from imu_bench.offline.exports import FORMATS
import pytest

WARNING = 'SIMULATED DATA'


def imu_bench(*arguments):
    said = io.StringIO()
    with redirect_stdout(said):
        assert main([*map(str, arguments)]) == 0
    return said.getvalue()


@pytest.fixture(scope='module')
def made(tmp_path_factory):
    """Return a recording that was simulated, and the same without a word beside it."""
    folder = tmp_path_factory.mktemp('simulated')
    imu_bench('simulate', 'machine_vibration', '--duration', '60s', '-o', folder / 'bag')
    shutil.copytree(folder / 'bag', folder / 'bare')
    (folder / 'bare' / 'truth.json').unlink()
    return folder


@pytest.fixture(scope='module')
def analysed(made):
    """Return terminal, page and JSON of both."""
    found = {}
    for name in ('bag', 'bare'):
        page, results = made / f'{name}.html', made / f'{name}.json'
        said = imu_bench('analyze', made / name, '--html', page, '--json', results)
        found[name] = said, page.read_text('utf-8'), json.loads(results.read_text('utf-8'))
    return found


@pytest.mark.slow
def test_terminal_page_and_json_say_it(analysed):
    said, page, results = analysed['bag']
    assert said.startswith(f'{WARNING}: 6 of 6 recordings are of no real sensor.')
    assert re.search(rf'<p class="banner"[^>]*>{WARNING}', page)
    assert all(recording['simulated'] for recording in results['recordings'])
    assert 'drifts least' not in page
    assert 'Of the simulation' in page


@pytest.mark.slow
def test_a_real_recording_is_not_called_simulated(analysed):
    said, page, results = analysed['bare']
    assert WARNING not in said + page
    assert not any(recording['simulated'] for recording in results['recordings'])


@pytest.mark.slow
def test_exports_say_it(made, analysed):
    topic = '/bench/mpu9250/imu/data_raw'
    for to in sorted({*FORMATS} - {'csv'}):
        text = imu_bench('export', made / 'bag.json', '--to', to, '--topic', topic)
        assert WARNING in text, to
        text = imu_bench('export', made / 'bare.json', '--to', to, '--topic', topic)
        assert WARNING not in text, to


@pytest.mark.slow
def test_the_table_says_it_in_a_column(made, analysed):
    for name, said in (('bag', 'true'), ('bare', 'false')):
        lines = imu_bench('export', made / f'{name}.json', '--to', 'csv').splitlines()
        assert lines[0].endswith(',simulated')
        assert {line.rpartition(',')[2] for line in lines[1:]} == {said}


@pytest.mark.slow
def test_comparisons_say_it(made, analysed):
    page = made / 'runs.html'
    imu_bench('compare', made / 'bag.json', made / 'bare.json', '--html', page)
    assert f'{WARNING}: 6 of 12 recordings' in page.read_text('utf-8')


@pytest.mark.slow
def test_a_plan_says_it(made):
    page, results = made / 'plan.html', made / 'plan.json'
    imu_bench('analyze', '--plan', 'static', made / 'bag', '--html', page, '--json', results)
    assert WARNING in page.read_text('utf-8')
    assert json.loads(results.read_text('utf-8'))['simulated']
