# SPDX-License-Identifier: Apache-2.0
"""Bags with topics of somebody else: names meant to harm, and many that nobody asked for."""

from http.server import BaseHTTPRequestHandler, HTTPServer
import json
from pathlib import Path
import shutil
import subprocess
from threading import Thread

from imu_bench.bags.topic_info import describe
from imu_bench.bags.writer import BagWriter
from imu_bench.cli.main import main
from msg_conversions import covariance
from msg_conversions.encoding import ImuTemplate
import numpy as np
import pytest

CHROMIUM = shutil.which('chromium') or shutil.which('chromium-browser')
START = 1_700_000_000_000_000_000


def write(bag, topic, count, frame='imu_link'):
    """Write Imu messages of white noise."""
    bag.add_topic(describe(topic, 'sensor_msgs/msg/Imu'))
    stamps = START + np.arange(count) * 10_000_000
    noise = np.random.default_rng(1).normal(0.0, 0.01, (count, 3))
    template = ImuTemplate(frame, acceleration_covariance=covariance.UNKNOWN)
    for stamp, row in zip(stamps, template.imu_rows(stamps, noise), strict=True):
        bag.write(topic, int(stamp), row.tobytes())


def test_forty_topics_that_are_too_short_are_one_line(tmp_path, capsys):
    with BagWriter(tmp_path / 'bag') as bag:
        write(bag, '/bench/left/imu/data_raw', 2000)
        for number in range(40):
            write(bag, f'/foreign_{number:02}/imu', 3)
    assert main(['analyze', str(tmp_path / 'bag')]) == 1
    (line,) = [line for line in capsys.readouterr().err.splitlines() if 'few samples' in line]
    named = ', '.join(f'/foreign_{number:02}/imu' for number in range(4))
    assert line.endswith(f': 40 topics have too few samples to analyse: {named} and 36 more')


BENCH = {'bench': '/bench/left /bench/right'}


def write_bench(folder, short=0):
    """Write a bag of two sensors and of somebody else, who began first and comes first."""
    with BagWriter(folder / 'bag', custom=BENCH) as bag:
        write(bag, '/a_camera/imu', 2000)
        for number in range(short):
            write(bag, f'/foreign_{number:02}/imu', 3)
        write(bag, '/bench/right/imu/data_raw', 2000)
        write(bag, '/bench/left/imu/data_raw', 2000)
    return str(folder / 'bag')


def test_what_nobody_asked_for_stands_apart(tmp_path, capsys):
    bag, page, document = write_bench(tmp_path), tmp_path / 'a.html', tmp_path / 'a.json'
    assert main(['analyze', bag, '--html', str(page), '--json', str(document)]) == 0
    heading = 'Of others: recorded as well, though nobody asked for it'
    sensors, others = capsys.readouterr().out.split(heading)
    assert 'a_camera' not in sensors
    assert 'right' in sensors
    assert 'a_camera/imu' in others
    assert 'left' not in others.replace(bag, '')
    result = json.loads(document.read_text())
    found = [(each['topic'], each['foreign']) for each in result['recordings']]
    own = [(f'/bench/{name}/imu/data_raw', False) for name in ('right', 'left')]
    assert found == [*own, ('/a_camera/imu', True)]
    ranked = result['comparison']['ranking']['linear_acceleration']
    assert {row['label'] for row in ranked} == {'left', 'right'}
    before, after = page.read_text().split(f'{heading}</h2>')
    assert ('<h2>a_camera</h2>' in before, '<h2>a_camera</h2>' in after) == (False, True)
    assert '2 sensors, ' in before
    assert ' 1 topic of others, apart.' in before


def test_who_asks_for_it_gets_it_like_a_sensor(tmp_path, capsys):
    bag, document = write_bench(tmp_path), tmp_path / 'a.json'
    topics = ['--topic', '/a_camera/imu', '--topic', '/bench/left/imu/data_raw']
    assert main(['analyze', bag, *topics, '--json', str(document)]) == 0
    result = json.loads(document.read_text())
    assert [each['foreign'] for each in result['recordings']] == [False, False]
    assert len(result['comparison']['ranking']['linear_acceleration']) == 2


@pytest.mark.slow
def test_what_others_lack_is_no_fault_of_the_bench(tmp_path, capsys):
    bag = write_bench(tmp_path, short=40)
    assert main(['analyze', bag]) == 0
    (line,) = [line for line in capsys.readouterr().err.splitlines() if 'few samples' in line]
    assert ': 40 topics of others have too few samples to analyse: /foreign_00/imu, ' in line


def test_a_plan_measures_the_bench_alone(tmp_path, capsys):
    bag, document = write_bench(tmp_path, short=3), tmp_path / 'plan.json'
    assert main(['analyze', bag, '--plan', 'static', '--json', str(document)]) == 0
    said = capsys.readouterr()
    assert 'camera' not in said.out
    assert said.err == ''
    assert 'camera' not in document.read_text()


@pytest.fixture
def listener():
    """Give an address of this machine, and what was asked of it."""
    asked = []

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self):
            asked.append(self.path)
            self.send_error(404)

        def log_message(self, *_):
            """Say nothing."""

    with HTTPServer(('127.0.0.1', 0), Handler) as server:
        thread = Thread(target=server.serve_forever)
        thread.start()
        yield f'http://127.0.0.1:{server.server_port}', asked
        server.shutdown()
        thread.join()


def browse(page: Path, profile: Path) -> str:
    """Return the document as Chromium has it when all scripts of a page have run."""
    done = subprocess.run(
        [
            CHROMIUM, '--headless', '--no-sandbox', '--disable-gpu', '--no-first-run',
            '--disable-background-networking', '--disable-component-update', '--disable-sync',
            f'--user-data-dir={profile}', '--virtual-time-budget=10000', '--dump-dom',
            page.as_uri(),
        ],
        capture_output=True, text=True, check=True,
    )  # fmt: skip
    return done.stdout


@pytest.mark.slow
@pytest.mark.skipif(CHROMIUM is None, reason='chromium is not installed')
def test_names_meant_to_harm_are_text(tmp_path, capsys, listener):
    address, asked = listener
    script = 'document.body.dataset.harmed=1'
    evil = f'"\'></script><script>{script}</script><img src={address}/a onerror="{script}">'
    terminal = '\x1b]0;owned\x07\x1b[2J[red]red[/red]'
    with BagWriter(tmp_path / 'bag') as bag:
        write(bag, f'/imu{evil}', 2000, frame=f'{evil}{{{{ 7 * 7 }}}}')
        write(bag, f'/b{terminal}', 2000, frame=terminal)
    page = tmp_path / 'report.html'
    assert main(['analyze', str(tmp_path / 'bag'), '--html', str(page)]) == 0
    said = capsys.readouterr()
    assert '\x1b' not in said.out + said.err
    assert '\x07' not in said.out + said.err
    assert '[red]' in said.out
    document = browse(page, tmp_path / 'profile')
    assert 'class="plot"' in document
    assert 'data-harmed' not in document
    assert asked == []
    # a page that does let it in would be caught
    page.write_text(f'<p title="{evil}</p>', encoding='utf-8')
    assert 'data-harmed' in browse(page, tmp_path / 'profile')
    assert asked == ['/a']
