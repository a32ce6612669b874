# SPDX-License-Identifier: Apache-2.0
"""What colcon, rosdep and pip read about the package agrees."""

import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import imu_bench

ROOT = Path(__file__).resolve().parent.parent
LICENCE = '# SPDX-License-Identifier: Apache-2.0'


def test_one_version_everywhere():
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    setup = (ROOT / 'setup.py').read_text(encoding='utf-8')
    assert manifest.get('format') == '3'
    assert manifest.findtext('version') == imu_bench.__version__
    assert re.search(r"version='([^']+)'", setup).group(1) == imu_bench.__version__


def test_manifest_names_the_build_type_and_licence():
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    assert manifest.findtext('export/build_type') == 'ament_python'
    assert manifest.findtext('license') == 'Apache-2.0'
    assert 'Apache License' in (ROOT / 'LICENSE').read_text(encoding='utf-8')


def test_executables_land_where_ros2_run_looks():
    text = (ROOT / 'setup.cfg').read_text(encoding='utf-8')
    assert text.count('$base/lib/imu_bench') == 2
    assert (ROOT / 'resource' / 'imu_bench').read_bytes() == b''


def test_run_works_where_it_is_called_from(tmp_path):
    house, caller = tmp_path / 'house', tmp_path / 'caller'
    (house / '.venv' / 'bin').mkdir(parents=True)
    caller.mkdir()
    for name in ('run', 'setup.py'):
        shutil.copy(ROOT / name, house)
    (house / '.venv' / 'bin' / 'python').symlink_to(sys.executable)
    with (house / 'setup.py').open('rb') as file:
        state = subprocess.run(['cksum'], stdin=file, capture_output=True, check=True, text=True)
    (house / '.venv' / f'installed-run-{state.stdout.split()[0]}').touch()
    done = subprocess.run(
        [house / 'run', 'exec', 'pwd'], cwd=caller, capture_output=True, text=True, timeout=60,
        env=os.environ | {'PYTHON': sys.executable}, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, str(caller), '')


def test_every_source_file_names_its_licence():
    folders = ('imu_bench', 'msg_conversions', 'test', 'benchmarks', 'launch')
    files = [path for folder in folders for path in (ROOT / folder).rglob('*.py')]
    assert files
    missing = [
        path.relative_to(ROOT)
        for path in files
        if LICENCE not in path.read_text(encoding='utf-8').splitlines()[:2]
    ]
    assert not missing
