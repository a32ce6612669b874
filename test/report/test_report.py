# SPDX-License-Identifier: Apache-2.0
"""The report stands alone, says what was found, and cannot be broken by what is in a bag."""

from dataclasses import replace
from html.parser import HTMLParser
import re
import shutil
import subprocess

from imu_bench.errors import BenchError
from imu_bench.metrology.estimate import Estimate
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import Analysis, Failure
from imu_bench.offline.presentation.pages import render_report as render
from imu_bench.offline.presentation.pages import write_report
from imu_bench.samples import Samples
import numpy as np
import pytest

# per sensor and quantity: Allan, spectrum, time, distribution, noise over time; 2 tracked biases;
# of all sensors Allan and spectrum, and a small Allan figure of each axis
FIGURES = 2 * 2 * 5 + 2 + 4 + 2 * 3
EVIL = '<script>alert(1)</script>'
CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')


def moved_once(seed):
    rng = np.random.default_rng(seed)
    n, rate = 12_000, 100.0
    stamps = 1_700_000_000_000_000_000 + np.arange(n) * int(1e9 / rate)
    time = np.arange(n) / rate
    acceleration = rng.normal([0.0, 0.0, 9.8], 0.02, (n, 3))
    acceleration[:, 0] += 0.02 * np.sin(2 * np.pi * 12.5 * time)
    gyro = rng.normal(0.0, 1e-3, (n, 3))
    gyro[6000:6500, 2] += 0.3
    return Samples(stamps, acceleration, gyro)


@pytest.fixture(scope='module')
def analysis(recorded):
    topics = ('/bench/mpu9250/imu/data_raw', '/imu')
    found = [analyse(recorded(moved_once(k), topic=topic)) for k, topic in enumerate(topics, 1)]
    return Analysis(tuple(found), (Failure('broken.bag', 'cut off'),))


@pytest.fixture(scope='module')
def page(analysis):
    return render(analysis)


class Elements(HTMLParser):
    """Every start tag with its attributes, and the text of the style elements."""

    def __init__(self, page):
        super().__init__()
        self.tags, self.style, self.text = [], '', ''
        self._inside = ''
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))
        self._inside = tag

    def handle_endtag(self, tag):
        self._inside = ''

    def handle_data(self, data):
        if self._inside == 'style':
            self.style += data
        elif self._inside != 'script':
            self.text += data


@pytest.mark.slow
def test_nothing_comes_from_the_network(page):
    found = Elements(page)
    names = {tag for tag, _ in found.tags}
    assert names.isdisjoint({'link', 'iframe', 'img', 'object', 'embed', 'base', 'form'})
    for tag, attributes in found.tags:
        for name in ('src', 'srcset', 'action', 'data'):
            assert name not in attributes, (tag, attributes)
        assert attributes.get('href', '#').startswith('#')
    assert 'url(' not in found.style
    assert '@import' not in found.style


def test_it_is_small(page):
    """The library, and of each sensor what leaves six of them below 1.5 MB."""
    library = len(re.search(r'id="packed-library">([^<]*)<', page)[1])
    assert library < 500_000
    assert library + 6 * (len(page.encode()) - library) / 2 < 1_500_000


def test_figures_are_valid_json_and_all_have_a_place(page, figures_in):
    documents = figures_in(page)
    places = [a['id'] for tag, a in Elements(page).tags if a.get('class') == 'plot']
    assert {document['target_id'] for document in documents} == set(places)
    assert len(places) == FIGURES


def test_it_says_what_was_found(page):
    text = Elements(page).text
    assert 'mpu9250' in text
    assert 'noise density' in text
    assert 'The sensor moved' in text
    assert '12.5 Hz in linear_acceleration.x' in text
    assert 'broken.bag: cut off' in text
    assert 'm/s²/√Hz' in text
    assert 'µg/√Hz' in text
    assert 'Measured against the datasheet' in text


def test_a_term_that_is_not_observable_says_how_long_to_record(analysis):
    first = analysis.recordings[0]
    name, axis = next(iter(first.axes.items()))
    bound = Estimate.not_observable('m/s²', 'record about 3 h for 10 %', high=1e-4)
    changed = replace(axis, model=replace(axis.model, B=bound))
    found = replace(first, axes={name: changed})
    page = render(Analysis((found,)))
    assert 'title="record about 3 h for 10 %"' in page
    assert '&lt; 10' in page


@pytest.mark.parametrize('field', ['topic', 'source', 'frame_id'])
def test_text_from_a_bag_is_escaped(analysis, field):
    evil = replace(analysis.recordings[0], **{field: f'/{EVIL}"\'/x/imu/data'})
    other = replace(analysis.recordings[1], **{field: EVIL})
    page = render(Analysis((evil, other), (Failure(EVIL, EVIL),)))
    assert EVIL not in page
    assert '&lt;script&gt;alert(1)&lt;/script&gt;' in page
    assert page.count('<script') == render(analysis).count('<script')


def test_many_sensors_begin_with_one_curve_each_and_any_axis_can_be_chosen(page, figures_in):
    [together] = [
        figure
        for figure in figures_in(page)
        if figure['doc']['roots'][0]['attributes'].get('height', 0) > 400
    ][:1]
    lines = [
        (one['attributes']['tags'], one['attributes'].get('visible', True))
        for one in together['doc']['roots'][0]['attributes']['renderers']
        if one['attributes']['glyph']['name'] == 'Line'
    ]
    assert [seen for _, seen in lines].count(True) == 2
    assert all(('noisiest axis' in tags) == seen for tags, seen in lines)
    assert sorted(tags[-2] for tags, _ in lines) == ['x', 'x', 'y', 'y', 'z', 'z']
    offered = [a['data-choice'] for tag, a in Elements(page).tags if a.get('class') == 'choice']
    assert offered[:5] == ['noisiest axis', 'x', 'y', 'z', 'all axes']


def test_a_single_sensor_needs_no_comparison(analysis):
    assert 'All sensors together' not in render(Analysis(analysis.recordings[:1]))


def test_constant_axes_do_not_break_it(analysis, recorded, caplog):
    silent = recorded(moved_once(3), topic='/still')
    gyro = np.array(silent.samples.angular_velocity)
    gyro[:] = 0.0
    still = analyse(replace(silent, samples=replace(silent.samples, angular_velocity=gyro)))
    page = render(Analysis((still, *analysis.recordings)))
    assert 'constant at zero' in page
    assert caplog.messages == []


def test_it_cannot_be_written_where_there_is_no_folder(analysis, tmp_path):
    with pytest.raises(OSError, match='No such file') as caught:
        write_report(analysis, tmp_path / 'none' / 'r.html')
    assert not isinstance(caught.value, BenchError)


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason='chromium is not installed')
@pytest.mark.parametrize('width', [390, 1280])
def test_it_renders_without_errors(page, tmp_path, width):
    path = tmp_path / 'report.html'
    path.write_text(page, encoding='utf-8')
    done = subprocess.run(
        [
            CHROMIUM, '--headless', '--no-sandbox', '--disable-gpu', '--no-first-run',
            '--disable-background-networking', '--disable-component-update', '--disable-sync',
            '--host-resolver-rules=MAP * ~NOTFOUND', f'--user-data-dir={tmp_path / "profile"}',
            '--enable-logging=stderr', f'--window-size={width},900',
            '--virtual-time-budget=20000', '--dump-dom', path.as_uri(),
        ],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    console = [line for line in done.stderr.splitlines() if 'CONSOLE' in line]
    complaints = [line for line in console if not re.search(r'INFO:CONSOLE.*\[bokeh', line)]
    assert complaints == []
    assert not any('could not' in line for line in console)
    places = done.stdout.count('class="plot"')
    drawn = len(re.findall(r'class="plot"[^>]*><div[^>]*class="bk-', done.stdout))
    assert places == drawn == FIGURES
