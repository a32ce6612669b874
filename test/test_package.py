# SPDX-License-Identifier: Apache-2.0
"""What colcon, rosdep and pip read about the package agrees."""

import ast
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree

import imu_bench
import pytest
import yaml

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = 'imu_bench', 'msg_conversions', 'test', 'benchmarks', 'launch'
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
        [house / 'run', 'exec', 'pwd'], cwd=caller, capture_output=True, text=True,
        env=os.environ | {'PYTHON': sys.executable}, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout.strip(), done.stderr) == (0, str(caller), '')


@pytest.mark.parametrize('named', ['', 'mine'])
def test_run_says_which_python_it_takes_and_why(tmp_path, named):
    shutil.copy(ROOT / 'run', tmp_path)
    (tmp_path / 'setup.py').touch()
    # stands in for an interpreter that is too old, and for one that makes nothing
    old, new = 'case $1 in --version) echo Python 3.8.1;; *) false;; esac', 'test "$1" = -c'
    for name, does in (('python3', old), ('python3.12', new), ('mine', new)):
        (tmp_path / name).write_text(f'#!/bin/sh\n{does}\n')
        (tmp_path / name).chmod(0o755)
    done = subprocess.run(
        [tmp_path / 'run', 'exec', 'true'], capture_output=True, text=True, check=False,
        env={'PATH': f'{tmp_path}:/usr/bin:/bin', 'PYTHON': named},
    )  # fmt: skip
    assert done.returncode == 1
    why = 'mine: PYTHON names it' if named else 'python3.12: the first on PATH that is 3.10 or '
    assert f'/{why}' in done.stderr
    assert ('passed over: python3 (Python 3.8.1)' in done.stderr) == (not named)


@pytest.mark.parametrize(
    ('words', 'sourced', 'said'),
    [
        (('--ros', 'humble'), '', '--ros humble: there are wheels of jazzy and kilted'),
        (('--ros',), '', 'there are wheels of'),
        (('--ros', 'kilted'), 'lyrical', 'lyrical is sourced here; leave it out'),
    ],
)
def test_run_says_which_ros_it_can_have(words, sourced, said):
    own = {key: value for key, value in os.environ.items() if key != 'ROS_DISTRO'}
    done = subprocess.run(
        [ROOT / 'run', 'test', *words], capture_output=True, text=True,
        env=own | ({'ROS_DISTRO': sourced} if sourced else {}), check=False,
    )  # fmt: skip
    assert done.returncode == 1
    assert said in done.stderr


def test_every_distribution_that_run_offers_has_its_wheels():
    run, setup = ((ROOT / name).read_text(encoding='utf-8') for name in ('run', 'setup.py'))
    offered = re.findall(r'(\w+)\) venv=\.venv-\1 extra=(\S+) ;;', run)
    assert offered
    for name, extra in offered:
        assert f"'{extra}': ['ros-{name}-rclpy[fastrtps]==" in setup


def test_every_source_file_names_its_licence():
    files = [path for folder in FOLDERS for path in (ROOT / folder).rglob('*.py')]
    assert files
    missing = [
        path.relative_to(ROOT)
        for path in files
        if LICENCE not in path.read_text(encoding='utf-8').splitlines()[:2]
    ]
    assert not missing


def rosdep():
    return yaml.safe_load((ROOT / 'test' / 'rosdep_keys.yaml').read_text(encoding='utf-8'))


def named_in_manifest():
    """Return what package.xml depends on, of whatever kind."""
    manifest = ElementTree.parse(ROOT / 'package.xml').getroot()
    return [each.text for each in manifest if each.tag.endswith('depend')]


def test_rosdep_finds_a_package_of_ubuntu_for_every_key():
    index, named = rosdep(), named_in_manifest()
    assert len(named) == len(set(named))
    assert [key for key in named if key not in index['keys'] and key not in index['ros']] == []


def test_what_pip_requires_is_in_the_manifest_or_optional():
    setup = (ROOT / 'setup.py').read_text(encoding='utf-8')
    required = re.search(r'install_requires=\[(.*?)\]', setup, re.DOTALL).group(1)
    names = set(re.findall(r"'([\w.-]+)", required))
    index = rosdep()
    keyed = {index['pip'][key] for key in named_in_manifest() if key in index['pip']}
    assert names - keyed == set(index['without'])
    text = (ROOT / 'docs' / 'workspace.md').read_text(encoding='utf-8')
    assert [name for name in index['without'] if name not in text] == []


BLOCKED = """
import sys
for name in ('lz4', 'backports', 'compression.zstd', 'rosbags', 'bokeh', 'periphery'):
    sys.modules[name] = None
from imu_bench.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture
def with_the_keys_alone():
    """Return what runs the command with nothing but what has a key of rosdep."""

    def run(*words):
        command = [sys.executable, '-c', BLOCKED, *map(str, words)]
        return subprocess.run(command, capture_output=True, text=True, check=False)

    return run


@pytest.fixture
def native(tmp_path):
    path = tmp_path / 'mine.csv'
    rows = [f'{n / 100},{(n * 7919) % 101 / 1e4}' for n in range(400)]
    path.write_text('\n'.join(['stamp_s,angular_velocity.x', *rows]), encoding='utf-8')
    return path


@pytest.mark.slow
def test_analysis_needs_no_optional_package(with_the_keys_alone, native, tmp_path):
    done = with_the_keys_alone('analyze', native, '--json', tmp_path / 'results.json')
    assert (done.returncode, done.stderr) == (0, ''), done.stdout
    assert (tmp_path / 'results.json').is_file()


@pytest.mark.slow
def test_who_needs_an_optional_package_is_told_in_one_line(with_the_keys_alone, native, tmp_path):
    done = with_the_keys_alone('analyze', native, '--html', tmp_path / 'report.html')
    assert done.returncode == 1
    said = 'imu-bench: error: a page with figures needs bokeh: pip install bokeh\n'
    assert done.stderr.endswith(said)
    assert 'Traceback' not in done.stderr


def imports(path):
    """Yield the top names of the modules that a file imports, at whatever place in it."""
    for node in ast.walk(ast.parse(path.read_text(encoding='utf-8'))):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition('.')[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.partition('.')[0]


@pytest.mark.slow
def test_what_the_manifest_does_not_name_is_known_to_be_optional():
    files = [each for name in FOLDERS for each in (ROOT / name).rglob('*.py')]
    imported = {module for path in files for module in imports(path)}
    index = rosdep()
    declared = {index['pip'][key].lower() for key in named_in_manifest() if key in index['pip']}
    declared |= set(index['ros']) | {'yaml', 'serial'}
    declared |= {'_pytest', 'markupsafe', 'rosidl_generator_py'}  # of pytest, Jinja2 and rclpy
    declared |= {'isal'}  # nobody misses it: zlib does the same
    ours = {*FOLDERS, *(path.stem for path in files)}
    conftest = ast.parse((ROOT / 'conftest.py').read_text(encoding='utf-8')).body
    (optional,) = (
        ast.literal_eval(node.value) for node in conftest
        if isinstance(node, ast.Assign) and node.targets[0].id == 'OPTIONAL'
    )  # fmt: skip
    assert imported - declared - ours - sys.stdlib_module_names - optional == set()


def test_no_two_test_files_share_a_name():
    # the plugin of launch_testing imports each by its name alone
    names = [path.name for path in (ROOT / 'test').rglob('test_*.py')]
    assert sorted(names) == sorted(set(names))


LAUNCH_TESTING = """
from _pytest.pathlib import import_path
import pytest
def pytest_pycollect_makemodule(module_path, parent):
    newer = tuple(map(int, pytest.__version__.split('.')[:2])) >= (8, 1)
    options = {'consider_namespace_packages': False} if newer else {}
    module = import_path(module_path, root=parent.config.rootpath, **options)
    assert not hasattr(module, 'generate_test_description')
"""
"""What launch_testing/pytest/hooks.py of ros2/launch does to each file of tests: it imports it."""


WITHOUT_LIBRARIES = {
    'test_whole.py': 'import allantools\n\ndef test_a(): pass\n',
    'test_part.py': 'def test_b():\n    import lz4\n',
    'test_command.py': """
import subprocess, sys
def test_c():
    said = subprocess.run([sys.executable, '-c', 'exit("it needs bokeh: pip install bokeh")'],
                          capture_output=True, text=True, check=False)
    assert said.returncode == 0
""",
    'test_shared.py': """
import pytest
@pytest.fixture(scope='module')
def made():
    try:
        import rosbags
    except ImportError:
        pass
    assert 'rosbags' in globals()
def test_d(made): pass
def test_e(made): pass
""",
    'ours.py': 'raise RuntimeError("it needs bokeh: pip install bokeh")\n',
    'test_half.py': 'import ours\n\nclass Later: pass\n\ndef test_g(): pass\n',
    'test_other.py': 'from test_half import Later\n\ndef test_h(): pass\n',
    'test_wrong.py': 'def test_f():\n    assert 1 + 1 == 3\n',
}

ABSENT = """
import sys, pytest
gone = 'allantools', 'bokeh', 'lz4', 'rosbags'
finders = [finder.find_spec for finder in sys.meta_path]
class Others:
    def find_spec(self, name, path=None, target=None):
        if name not in gone:
            return next((spec for find in finders if (spec := find(name, path, target))), None)
sys.meta_path[:] = [Others()]
plugins = 'no:cacheprovider', 'like_launch_testing'
sys.exit(pytest.main(['-q', '-rs', '--import-mode=importlib', *(f'-p{name}' for name in plugins)]))
"""


@pytest.mark.slow
@pytest.mark.parametrize('plugin', ['', LAUNCH_TESTING], ids=['alone', 'launch_testing'])
def test_without_a_library_its_tests_are_skipped_with_its_name_and_fail_in_ci(tmp_path, plugin):
    shutil.copy(ROOT / 'conftest.py', tmp_path)
    (tmp_path / 'like_launch_testing.py').write_text(plugin)
    for name, text in WITHOUT_LIBRARIES.items():
        (tmp_path / name).write_text(text)

    def run(**more):
        outer = 'CI', 'PYTEST_ADDOPTS'  # colcon has options of its own
        own = {key: value for key, value in os.environ.items() if key not in outer} | more
        return subprocess.run(
            [sys.executable, '-c', ABSENT], cwd=tmp_path, env=own, capture_output=True, text=True,
            check=False,
        )  # fmt: skip

    done = run()
    assert '1 failed, 7 skipped' in done.stdout, done.stdout + done.stderr
    for library in ('allantools', 'bokeh', 'lz4', 'rosbags'):
        assert f'needs {library}, which is not installed' in done.stdout
    strict = run(CI='true')
    assert 'skipped' not in strict.stdout
    assert strict.returncode != 0


def test_every_placeholder_of_a_release_is_in_its_list():
    listed = (ROOT / 'docs' / 'release.md').read_text(encoding='utf-8')
    for name in ('package.xml', 'setup.py', 'docs/workspace.md'):
        text = (ROOT / name).read_text(encoding='utf-8')
        for found in re.findall(r'\S*OWNER/imu_bench|[\w@-]+\.invalid', text):
            assert found.strip('<>').split('>')[-1] in listed, name
            assert name in listed
