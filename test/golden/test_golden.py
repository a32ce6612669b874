# SPDX-License-Identifier: Apache-2.0
"""
Verbs that work on recordings say and write what they did: words exactly, numbers to 1e-9.

`IMU_BENCH_WRITE_GOLDEN=1 pytest test/golden` makes what is found what is expected; look at
the difference before it is committed.
"""

from __future__ import annotations

import contextlib
from importlib import util
import io
import json
from pathlib import Path
import shutil

from imu_bench.cli.main import main
import pytest

pytestmark = pytest.mark.data

SPEC = util.spec_from_file_location('golden', Path(__file__).with_name('golden.py'))
golden = util.module_from_spec(SPEC)
SPEC.loader.exec_module(golden)


def command(line, columns):
    """Run the command in a terminal of this width, and return exit code, stdout and stderr."""
    out, err = io.StringIO(), io.StringIO()
    with (
        pytest.MonkeyPatch.context() as patch,
        contextlib.redirect_stdout(out),
        contextlib.redirect_stderr(err),
    ):
        patch.setenv('COLUMNS', str(columns))
        patch.setenv('TERM', 'xterm')
        out.isatty = lambda: True
        try:
            code = main(line)
        except SystemExit as leave:  # argparse leaves this way
            code = leave.code
    return code, out.getvalue(), err.getvalue()


@pytest.fixture(scope='module')
def cases(shared_data, tmp_path_factory):
    folder = tmp_path_factory.mktemp('golden')
    yield golden.Golden(command, folder, shared_data)
    shutil.rmtree(folder)  # bags


WRAPPED = ('compare', 'compare_runs')
"""Lines with the folder in them, whose name is longer or shorter, break elsewhere."""


@pytest.mark.slow
@pytest.mark.parametrize('name', golden.CASES)
def test_the_same_as_before(cases, name):
    found = cases.result(name)
    if golden.WRITE:
        golden.keep(name, found)
    expected = golden.kept(name)
    if name in WRAPPED:
        assert ''.join(found['text'].split()) == ''.join(expected['text'].split())
    else:
        assert found['text'] == expected['text']
    found = json.loads(json.dumps(found['files']))
    assert golden.differences(found, expected['files']) == []


def test_what_is_kept_is_of_a_case():
    names = {path.name.partition('.')[0] for path in golden.EXPECTED.iterdir()}
    assert names == set(golden.CASES)


@pytest.mark.parametrize(
    ('found', 'expected', 'differ'),
    [
        ({'a': [1.0, 2.0]}, {'a': [1.0, 2.0 + 1e-9]}, False),
        ({'a': [1.0, 2.0]}, {'a': [1.0, 2.0 + 1e-8]}, True),
        ({'a': 1}, {'a': 1, 'b': 2}, True),
        ({'a': [1]}, {'a': [1, 2]}, True),
        ({'a': 'x'}, {'a': 'y'}, True),
    ],
)
def test_a_difference_is_found(found, expected, differ):
    assert bool(golden.differences(found, expected)) == differ
