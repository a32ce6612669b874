# SPDX-License-Identifier: Apache-2.0
"""What pip gets: an sdist, the wheel made of it, and the wheel at work in an empty folder."""

import os
from pathlib import Path
import shutil
import subprocess
import sys
import sysconfig
import tarfile

import imu_bench
import pytest

ROOT = Path(__file__).resolve().parent.parent
PARTS = ('imu_bench', 'msg_conversions', 'config', 'launch', 'resource', 'docs/man')
FILES = ('setup.py', 'setup.cfg', 'pyproject.toml', 'package.xml', 'README.md',
         'LICENSE')  # fmt: skip


def run(*command, cwd, **more):
    """Run a command without what this process has on its path; return what it printed."""
    clean = {k: v for k, v in os.environ.items() if k not in ('PYTHONPATH', 'PYTHONHOME')}
    done = subprocess.run(
        list(map(str, command)), cwd=cwd, env=clean | more, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope='module')
def built(tmp_path_factory):
    """Return sdist and wheel; the wheel is built of what is in the sdist."""
    folder = tmp_path_factory.mktemp('built')
    source = folder / 'source'
    for part in PARTS:
        shutil.copytree(ROOT / part, source / part, ignore=shutil.ignore_patterns('__pycache__'))
    for name in FILES:
        shutil.copy(ROOT / name, source)
    hook = 'from setuptools.build_meta import build_{0}; build_{0}("..")'
    run(sys.executable, '-c', hook.format('sdist'), cwd=source)
    (sdist,) = folder.glob('*.tar.gz')
    with tarfile.open(sdist) as file:
        file.extractall(folder, filter='data')
    unpacked = folder / f'imu_bench-{imu_bench.__version__}'
    run(sys.executable, '-c', hook.format('wheel'), cwd=unpacked)
    (wheel,) = folder.glob('*.whl')
    return sdist, wheel


@pytest.fixture(scope='module')
def place(built, tmp_path_factory):
    """Return an empty folder, and the programs of an environment with the wheel alone."""
    folder = tmp_path_factory.mktemp('place')
    run(sys.executable, '-m', 'venv', '--without-pip', folder / 'venv', cwd=folder)
    there = folder / 'venv' / 'bin'
    run(sys.executable, '-m', 'pip', '--python', there / 'python', 'install', '--no-deps',
        '--no-index', '--quiet', built[1], cwd=folder)  # fmt: skip
    # the libraries are those of this environment; a .pth of theirs, such as ours, is not followed
    others = {sysconfig.get_path(kind) for kind in ('purelib', 'platlib')}
    where = 'import sysconfig; print(sysconfig.get_path("purelib"))'
    mine = run(there / 'python', '-c', where, cwd=folder).strip()
    Path(mine, 'others.pth').write_text('\n'.join(sorted(others)))
    (folder / 'empty').mkdir()
    return folder / 'empty', there


@pytest.mark.slow
def test_everything_is_installed(place):
    folder, there = place
    where = run(there / 'python', '-c', 'import imu_bench; print(imu_bench.__file__)', cwd=folder)
    prefix = there.parent
    assert Path(where).is_relative_to(prefix)
    share = prefix / 'share' / 'imu_bench'
    for part in ('config', 'launch'):
        for path in (ROOT / part).rglob('*.yaml'):
            assert (share / path.relative_to(ROOT)).is_file()
    assert (share / 'launch' / 'bench_launch.py').is_file()
    assert (prefix / 'share' / 'man' / 'man1' / 'imu-bench.1').is_file()
    package = Path(where.strip()).parent
    for suffix in ('html', 'css', 'js', 'jinja', 'typed'):
        wanted = {path.relative_to(ROOT) for path in (ROOT / 'imu_bench').rglob(f'*.{suffix}')}
        assert wanted == {
            path.relative_to(package.parent) for path in package.rglob(f'*.{suffix}')
        }


@pytest.mark.slow
def test_it_works_in_an_empty_folder(place):
    folder, there = place
    command = there / 'imu-bench'
    assert 'mast_inclination' in run(command, 'list', 'benches', cwd=folder)
    sensor = there.parent / 'share' / 'imu_bench' / 'config' / 'sensors' / 'mpu9250.yaml'
    said = run(command, 'record', sensor, '-o', 'bag', '--direct', '--duration', '1s', cwd=folder)
    assert 'next: imu-bench analyze' in said
    run(command, 'analyze', 'bag', '--html', 'r.html', cwd=folder)
    assert 'bokeh' in (folder / 'r.html').read_text('utf-8').lower()


OFFLINE = """
import sys
sys.path.insert(0, sys.argv[1])
import elsewhere
from imu_bench.cli.main import main
for words in (
    'simulate mast_inclination --duration 5s -o there -q',
    'analyze there --json there.json --html there.html -q',
    'compare there.json there.json --html runs.html -q',
    'export there.json --to csv -o there.csv',
    'list',
):
    assert main(words.split()) == 0, words
import imu_bench as ib
assert len(ib.load('there.json')) == 2
"""


@pytest.mark.slow
def test_the_offline_part_needs_neither_linux_nor_ros(place):
    folder, there = place
    run(there / 'python', '-c', OFFLINE, ROOT / 'test', cwd=folder)
