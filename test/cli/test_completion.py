# SPDX-License-Identifier: Apache-2.0
"""The Tab key: what bash offers with the script that the command prints."""

import os
import shlex
import subprocess
import sys

from imu_bench.cli.main import verb_names
import pytest

_TAB = r"""
eval "$(imu-bench --completion bash)"
COMP_WORDS=({words}); COMP_CWORD=$(({count} - 1)); COMP_LINE={line}; COMP_POINT=${{#COMP_LINE}}
COMP_TYPE=9; COMP_KEY=9
$(complete -p imu-bench | sed 's/.*-F \([^ ]*\) .*/\1/') imu-bench "${{COMP_WORDS[COMP_CWORD]}}" ''
printf '%s\n' "${{COMPREPLY[@]}}"
"""


@pytest.fixture
def tab(tmp_path):
    """Return a function that types a line, presses Tab, and returns what is offered."""
    (tmp_path / 'bin').mkdir()
    command = tmp_path / 'bin' / 'imu-bench'
    command.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} '
                       '-m imu_bench.cli.main "$@"\n')  # fmt: skip
    command.chmod(0o755)
    (tmp_path / 'here').mkdir()

    def press(line, *files):
        for name in files:
            (tmp_path / 'here' / name).touch()
        words = line.split(' ')
        script = _TAB.format(
            words=' '.join(map(shlex.quote, words)), count=len(words), line=shlex.quote(line)
        )
        path = [*filter(None, [os.environ.get('PYTHONPATH')]), *map(os.path.abspath, sys.path[:1])]
        done = subprocess.run(
            ['bash', '--norc', '-c', script],
            cwd=tmp_path / 'here', capture_output=True, text=True, check=False,
            env=os.environ | {
                'PATH': f'{command.parent}:{os.environ["PATH"]}',
                'PYTHONPATH': os.pathsep.join(path),
            },
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return [offered.strip() for offered in done.stdout.splitlines()]

    return press


def test_verbs(tab):
    offered = tab('imu-bench ')
    assert {verb.strip('_') for verb in verb_names()} <= set(offered)
    assert tab('imu-bench ana') == ['analyze']


@pytest.mark.parametrize(
    ('line', 'offered'),
    [
        ('imu-bench analyze bag --ht', ['--html']),
        ('imu-bench list bench', ['benches']),
        ('imu-bench export r.json --to kal', ['kalibr', 'kalman']),
        ('imu-bench doctor mast_inclination_', ['mast_inclination_hardware']),
        ('imu-bench simulate mast_inclination --scenario stil', ['still']),
        ('imu-bench analyze bag --plan six', ['six-position']),
        ('imu-bench record mast_inclination --test tilt_', ['tilt_fine']),
    ],
)
def test_options_and_names(tab, line, offered):
    assert sorted(tab(line)) == offered


@pytest.mark.slow
def test_files(tab):
    files = 'bench.yaml', 'mine.csv', 'mine.yaml'
    assert tab('imu-bench doctor mi', *files) == ['mine.yaml']
    assert sorted(tab('imu-bench analyze mi', *files)) == ['mine.csv', 'mine.yaml']


def test_a_bench_that_is_wrong_ends_nothing(tab):
    assert tab('imu-bench record no_such_bench --test ti') == ['']


@pytest.mark.parametrize(
    ('shell', 'words'), [('zsh', 'compdef'), ('fish', 'complete --command imu-bench')]
)
def test_the_script_of_other_shells(imu_bench, shell, words):
    code, out, err = imu_bench('--completion', shell)
    assert (code, err) == (0, '')
    assert words in out


def test_help_says_how(imu_bench):
    assert 'imu-bench --completion bash' in ' '.join(imu_bench('--help')[1].split())
