# SPDX-License-Identifier: Apache-2.0
"""The command: verbs, exit codes, and errors of one line."""

import os
import subprocess
import sys

from imu_bench.cli import main as entry
from imu_bench.errors import RecordingError
from imu_bench.version import __version__
import pytest


@pytest.fixture
def verb(monkeypatch):
    """Return a function that makes the command run something."""

    def install(action):
        def build():
            parser = original()
            parser.set_defaults(run=lambda arguments: action())
            return parser

        monkeypatch.setattr(entry, 'build_parser', build)

    original = entry.build_parser
    return install


def raises(error):
    def action():
        raise error

    return action


def test_help_names_the_verbs(imu_bench):
    code, out, _ = imu_bench('--help')
    assert code == 0
    assert 'analyze' in out


def test_version(imu_bench):
    assert imu_bench('--version') == (0, f'imu-bench {__version__}\n', '')


@pytest.mark.parametrize('arguments', [(), ('fly',), ('analyze',), ('analyze', 'x', '--tau', 'a')])
def test_wrong_usage(imu_bench, arguments):
    assert imu_bench(*arguments)[0] == 2


@pytest.mark.parametrize(
    ('arguments', 'usage', 'hint'),
    [
        (('analyze', 'x', '--figurse', 'd'), 'imu-bench analyze', "did you mean '--figures'?"),
        (('simulate', 'b', '-o', 'd', '--sede=1'), 'imu-bench simulate', "mean '--seed'?"),
        (('compare', 'x', '--qqq'), 'imu-bench compare', 'unrecognized arguments: --qqq\n'),
    ],
)
def test_an_unknown_option_shows_the_usage_of_its_verb(imu_bench, arguments, usage, hint):
    code, _, err = imu_bench(*arguments)
    assert code == 2
    assert err.startswith(f'usage: {usage} ')
    assert hint in err.splitlines(keepends=True)[-1]


def test_help_imports_nothing_heavy():
    script = (
        'import sys\n'
        'from imu_bench.cli.main import build_parser\n'
        'build_parser().format_help()\n'
        "print([m for m in ('numpy', 'scipy', 'bokeh', 'rich', 'rosbags', 'rclpy') "
        'if m in sys.modules])'
    )
    done = subprocess.run(
        [sys.executable, '-c', script], capture_output=True, text=True, check=True
    )
    assert done.stdout == '[]\n'


@pytest.mark.parametrize(
    ('error', 'code', 'line'),
    [
        (RecordingError('x.bag: cut\noff'), 1, 'imu-bench: error: x.bag: cut off\n'),
        (
            PermissionError(13, 'Permission denied', '/root/r.html'),
            1,
            'imu-bench: error: /root/r.html: Permission denied\n',
        ),
        (
            OSError(28, 'No space left on device'),
            1,
            'imu-bench: error: No space left on device\n',
        ),
        (RecordingError('\x1b[31mred'), 1, 'imu-bench: error: \\x1b[31mred\n'),
        (RecordingError('3\u202f600 samples'), 1, 'imu-bench: error: 3 600 samples\n'),
        (KeyboardInterrupt(), 130, 'imu-bench: stopped\n'),
    ],
)
def test_an_error_is_one_line(imu_bench, verb, error, code, line):
    verb(raises(error))
    assert imu_bench() == (code, '', line)


BOMB = '\n'.join(
    ['a0: &a0 [x, x, x, x, x, x, x, x, x, x]']
    + [f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 10)}]' for n in range(1, 6)]
)
"""Half a KiB that stands for a million entries."""


@pytest.mark.parametrize(
    'arguments',
    [
        pytest.param(('demo', 'bomb.yaml'), marks=pytest.mark.ros),
        ('doctor', 'bomb.yaml'),
        ('simulate', 'bomb.yaml', '-o', 'out'),
        ('simulate', 'machine_vibration', '--scenario', 'bomb.yaml', '-o', 'out'),
        ('campaign', 'bomb.yaml', '-o', 'out'),
        ('record', 'bomb.yaml', '-o', 'out'),
        ('record', 'bench.yaml', '-o', 'out'),
        ('analyze', 'still.csv', '--datasheet', 'bomb.yaml'),
    ],
    ids=' '.join,
)
def test_yaml_that_grows_is_one_line(imu_bench, tmp_path, monkeypatch, arguments):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'bomb.yaml').write_text(BOMB)
    (tmp_path / 'bench.yaml').write_text('name: one\nsensors: [{file: bomb.yaml}]')
    (tmp_path / 'still.csv').write_text('0,0,9.8\n' * 100)
    code, out, err = imu_bench(*arguments)
    assert (code, out, len(err.splitlines())) == (1, '', 1), err
    assert err.startswith('imu-bench: error: bomb.yaml: not YAML: it has more than 100000 entries')
    assert not (tmp_path / 'out').exists()


def run_with(encoding, *arguments):
    return subprocess.run(
        [sys.executable, '-m', 'imu_bench.cli.main', *map(str, arguments)],
        capture_output=True, encoding=encoding, check=False,
        env=os.environ | {'PYTHONIOENCODING': encoding, 'COLUMNS': '100'},
    )  # fmt: skip


@pytest.mark.slow
def test_a_pipe_that_knows_no_greek(write_csv):
    done = run_with('ascii', 'analyze', write_csv())
    assert done.returncode == 0, done.stderr
    assert done.stderr == ''
    assert 'noise density' in done.stdout


@pytest.mark.slow
@pytest.mark.parametrize(('encoding', 'size'), [('ascii', '6 000'), ('utf-8', '6\u202f000')])
def test_thin_spaces_are_spaces_in_a_pipe(write_csv, encoding, size):
    done = run_with(encoding, 'analyze', write_csv())
    assert f'{size} samples' in done.stdout
    assert 'x202f' not in done.stdout


@pytest.mark.slow
def test_a_reader_that_leaves_early_is_no_crash(write_csv):
    command = f'"{sys.executable}" -m imu_bench.cli.main analyze "{write_csv()}" | head -1'
    done = subprocess.run(command, shell=True, capture_output=True, text=True, check=True)
    assert done.stderr == ''


def test_a_bug_is_not_hidden(verb):
    verb(raises(ZeroDivisionError()))
    with pytest.raises(ZeroDivisionError):
        entry.main([])
