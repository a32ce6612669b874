# SPDX-License-Identifier: Apache-2.0
"""A short run of `./run benchmark fuzz`: the whole command on damaged inputs of every kind."""

import os
from pathlib import Path
import subprocess
import sys

import pytest

ROOT = Path(__file__).resolve().parents[2]
CASES = 96
"""Three of every kind."""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != 'linux', reason='needs fork, pidfd and RLIMIT_AS of Linux')
def test_damaged_inputs_end_with_a_result_or_one_line():
    done = subprocess.run(
        [
            sys.executable,
            '-m',
            'benchmarks.fuzz',
            '--cases',
            str(CASES),
            '--seed',
            '7',
            '--jobs',
            '2',
        ],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert done.stderr == ''
    [total] = [line for line in done.stdout.splitlines() if line.startswith('| all |')]
    cases, results, errors, other = (int(cell) for cell in total.split('|')[2:6])
    assert other == 0
    assert cases == results + errors
    assert cases > 0.9 * CASES
    assert results > 0.2 * CASES
    assert errors > 0.1 * CASES


FIRST = """
import sys
from importlib import import_module
from benchmarks import fuzz
sys.path.insert(0, sys.argv[1])
fuzz.imu_bench = lambda arguments: import_module('imported_by_nobody_before').CODE
print(fuzz.case(7, 0, sys.argv[1]).said)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != 'linux', reason='needs fork, pidfd and RLIMIT_AS of Linux')
def test_bytecode_of_what_nobody_has_imported_before_is_no_file_of_the_command(tmp_path):
    (tmp_path / 'imported_by_nobody_before.py').write_text('CODE = 1\n')
    environment = {k: v for k, v in os.environ.items() if k != 'PYTHONDONTWRITEBYTECODE'}
    done = subprocess.run(
        [sys.executable, '-c', FIRST, str(tmp_path)],
        cwd=ROOT, env=environment, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.stdout, done.stderr) == ('\n', '')
