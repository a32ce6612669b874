# SPDX-License-Identifier: Apache-2.0
"""
Does `imu-bench analyze` survive whatever is put before it?

Recordings of every format, damaged on purpose: cut off, bits flipped, wrong counts, lengths,
stamps and values.  Each is analysed by the whole command, in a process of its own that may have
2 GB of address space and 30 s.  It must end with a result, or with one clear line and exit code 1;
no traceback, no file written but the outputs, nothing left behind, the recording untouched.
Every third is treated as if it were large, with its columns in files.
Prints what happened by format; exits 1 if anything else did.  Every case is made by the seed and
its number alone: `--case N --keep DIR` makes one again.
Run as ``python -m benchmarks.fuzz [CASES] [--seed S] [--case N] [--keep DIR] [--jobs N]``.
"""

from __future__ import annotations

import argparse
from collections import Counter, defaultdict
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
import hashlib
from importlib import import_module
import multiprocessing
import os
from pathlib import Path
import random
import resource
import select
import shutil
import signal
import sys
import tempfile
import time
from typing import NamedTuple

from imu_bench.cli.main import main as imu_bench
from imu_bench.offline.recordings import cache
import numpy as np

from benchmarks._fuzz_content import content, TWISTS
from benchmarks._fuzz_damage import damaged
from benchmarks._fuzz_formats import FORMATS

CASES = 2000
MEMORY = 2 << 30
SECONDS = 30.0
_LONGEST_LINE = 3000
_LATE = ('imu_bench.cli.running', 'imu_bench.cli.table', 'imu_bench.offline.analyse',
         'imu_bench.offline.report', 'scipy.io')  # fmt: skip
_WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC
_CHANGES = ('os.mkdir', 'os.remove', 'os.rename', 'os.rmdir', 'os.truncate', 'os.link',
            'os.symlink', 'os.chmod', 'os.utime')  # fmt: skip


class Verdict(NamedTuple):
    """What one case came to: 'result', 'error', or what is wrong with it."""

    number: int
    format: str
    verdict: str
    seconds: float
    peak: int
    said: str


def made(folder: Path, seed: int, number: int) -> tuple[str, Path, tuple[str, ...]]:
    """Write the recording of a case; return its format, path and options."""
    rng = random.Random(f'{seed}-{number}')
    name = list(FORMATS)[number % len(FORMATS)]
    twist = rng.choice(('', '', *TWISTS))
    found = content(twist, np.random.default_rng([seed, number]))
    path = FORMATS[name].write(folder, found)
    files = sorted(file for file in folder.rglob('*') if file.is_file())
    if twist == '' or rng.random() < 0.3:
        for _ in range(rng.choice((1, 1, 2))):
            file = rng.choice(files)
            file.write_bytes(damaged(file.read_bytes(), rng))
        if len(files) > 1 and rng.random() < 0.1:
            rng.choice(files).unlink()
    return name, path, FORMATS[name].options


def case(seed: int, number: int, home: str) -> Verdict:
    """Make a recording, analyse it in a child, and judge what came of it."""
    with tempfile.TemporaryDirectory(dir=home) as place:
        folder = Path(place)
        for part in ('in', 'out', 'tmp', 'cwd'):
            (folder / part).mkdir()
        try:
            name, path, options = made(folder / 'in', seed, number)
        except OverflowError:  # some writers refuse impossible stamps: then there is no recording
            return Verdict(number, list(FORMATS)[number % len(FORMATS)], 'not made', 0.0, 0, '')
        before = _digest(folder / 'in')
        began = time.perf_counter()
        child = os.fork()
        if child == 0:
            cache.LARGE = cache.LARGE if number % 3 else 1
            _analyse(folder, path, options)
        status, usage, late = _wait(child)
        took = time.perf_counter() - began
        said = (folder / 'err').read_text('utf-8', 'replace')
        verdict = _judge(folder, status, late, said, FORMATS[name].recordings)
        if _digest(folder / 'in') != before:
            verdict = 'the recording was changed'
        return Verdict(number, name, verdict, took, usage.ru_maxrss * 1024, said)


def _wait(child: int) -> tuple[int, resource.struct_rusage, bool]:
    ended = os.pidfd_open(child)
    try:
        late = not select.select([ended], [], [], SECONDS)[0]
        if late:
            os.kill(child, signal.SIGKILL)
        _, status, usage = os.wait4(child, 0)
    finally:
        os.close(ended)
    return status, usage, late


def _analyse(folder: Path, path: Path, options: Sequence[str]) -> None:
    """Run the command as a program of its own would run; does not return."""
    code = 70
    try:
        for stream, file in ((1, 'said'), (2, 'err')):
            os.dup2(os.open(folder / file, os.O_WRONLY | os.O_CREAT), stream)
        os.chdir(folder / 'cwd')
        os.environ['HOME'] = os.environ['TMPDIR'] = str(folder / 'tmp')
        tempfile.tempdir = None
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        sys.addaudithook(_watch(folder))
        outputs = [f'--{kind}={folder / "out" / f"r.{kind}"}' for kind in ('json', 'html')]
        code = imu_bench(['analyze', str(path), '--jobs', '1', *outputs, *options])
    except BaseException:  # whatever it is, this fork must not go on as its parent does
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stderr.flush()
        os._exit(code)


def _watch(folder: Path) -> object:
    """Return a hook that ends the program when it changes a file outside of its places."""
    places = tuple(str(folder / part) + os.sep for part in ('out', 'tmp'))

    def hook(event: str, arguments: tuple[object, ...]) -> None:
        path: object = None
        if event == 'open':
            path, _, flags = arguments
            if not (isinstance(flags, int) and flags & _WRITES):
                return
        elif event in _CHANGES:
            path = arguments[0]
        if isinstance(path, (str, bytes)) and os.fsdecode(path) != os.devnull:
            # shutil.rmtree names files relative to an open folder
            open_folder = arguments[-1] if event in ('os.remove', 'os.rmdir') else -1
            base = (
                os.getcwd() if open_folder == -1 else os.readlink(f'/proc/self/fd/{open_folder}')
            )
            whole = os.path.abspath(os.path.join(base, os.fsdecode(path)))
            if not (whole + os.sep).startswith(places):
                os.write(2, f'touched {whole} ({event})\n'.encode())
                os._exit(71)

    return hook


def _judge(folder: Path, status: int, late: bool, said: str, recordings: int) -> str:
    code = os.waitstatus_to_exitcode(status)
    lines = said.splitlines()
    left = [str(file.relative_to(folder)) for part in ('tmp', 'cwd')
            for file in (folder / part).iterdir()]  # fmt: skip
    if late:
        return f'no end after {SECONDS:g} s'
    if code not in (0, 1):
        return f'exit code {code}'
    if 'Traceback' in said or 'Warning' in said:
        return 'traceback or warning'
    if not all(line.startswith('imu-bench: error: ') for line in lines):
        return 'odd words on stderr'
    if any(len(line) > _LONGEST_LINE for line in lines):
        return 'an endless line'
    if left:
        return f'left behind: {left[0]}'
    if code == 0:
        return _result(folder / 'out', lines)
    # one line for each recording that fails
    return 'error' if 1 <= len(lines) <= recordings else f'exit code 1 with {len(lines)} lines'


def _result(folder: Path, lines: Sequence[str]) -> str:
    from imu_bench.offline import results

    if lines:
        return 'exit code 0 with an error'
    if '</html>' not in (folder / 'r.html').read_text('utf-8')[-100:]:
        return 'no whole report'
    found = results.read(folder / 'r.json').recordings
    return 'result' if found and all(recording.axes for recording in found) else 'empty result'


def _digest(folder: Path) -> str:
    known = hashlib.sha256()
    for file in sorted(folder.rglob('*')):
        known.update(f'{file}\0'.encode())
        if file.is_file():
            known.update(file.read_bytes())
    return known.hexdigest()


def _begin() -> None:
    """Import what the command imports late, once for all cases of this process."""
    for name in _LATE:
        import_module(name)


def run(cases: Sequence[int], seed: int, jobs: int) -> list[Verdict]:
    """Return the verdicts of some cases."""
    home = tempfile.mkdtemp(prefix='imu_bench_fuzz_')
    context = multiprocessing.get_context('spawn')
    try:
        with ProcessPoolExecutor(jobs, mp_context=context, initializer=_begin) as pool:
            pending = [pool.submit(case, seed, number, home) for number in cases]
            return [future.result() for future in pending]
    finally:
        shutil.rmtree(home, ignore_errors=True)


def show(verdicts: Sequence[Verdict]) -> bool:
    """Print what happened; return whether all of it was allowed."""
    by_format: dict[str, list[Verdict]] = defaultdict(list)
    for verdict in verdicts:
        by_format[verdict.format].append(verdict)
    print('| format | cases | results | clear errors | other | slowest | most memory |')
    print('|---|---|---|---|---|---|---|')
    everything = [('all', list(verdicts))] if len(by_format) > 1 else []
    for name, found in [*by_format.items(), *everything]:
        kinds = Counter(verdict.verdict for verdict in found)
        made = len(found) - kinds.pop('not made', 0)
        good, errors = kinds.pop('result', 0), kinds.pop('error', 0)
        slowest = max(verdict.seconds for verdict in found)
        peak = max(verdict.peak for verdict in found) / 1e6
        print(f'| {name} | {made} | {good} | {errors} | {kinds.total()} | {slowest:.1f} s '
              f'| {peak:.0f} MB |')  # fmt: skip
    bad = [v for v in verdicts if v.verdict not in ('result', 'error', 'not made')]
    for verdict in bad:
        print(f'\ncase {verdict.number} ({verdict.format}): {verdict.verdict}\n{verdict.said}')
    return not bad


def main() -> int:
    """Run the cases that the command line asks for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('cases', type=int, nargs='?', default=CASES)
    parser.add_argument('--seed', type=int, default=1)
    parser.add_argument('--case', type=int, action='append', help='only this one (repeatable)')
    parser.add_argument('--keep', type=Path, help='write the recordings of the cases there')
    parser.add_argument('--jobs', type=int, default=os.cpu_count() or 1)
    arguments = parser.parse_args()
    cases = arguments.case or range(arguments.cases)
    if arguments.keep is not None:
        for number in cases:
            folder = arguments.keep / str(number)
            folder.mkdir(parents=True)
            name, path, options = made(folder, arguments.seed, number)
            print(f'case {number} ({name}): {path} {" ".join(options)}')
        return 0
    print(f'seed {arguments.seed}: {len(cases)} damaged recordings\n')
    return 0 if show(run(cases, arguments.seed, arguments.jobs)) else 1


if __name__ == '__main__':
    sys.exit(main())
