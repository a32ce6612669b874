# SPDX-License-Identifier: Apache-2.0
"""
Does `imu-bench` survive whatever is put before it?

Recordings of every format, damaged on purpose: cut off, bits flipped, wrong counts, lengths,
stamps and values; databases with another schema, bombs; results in JSON for compare, export and
simulate, and YAML of every kind.  Each is read by the whole command, in a process of its own that
may have 1 GB of memory and 30 s of CPU time.  It must end with a result, or with one clear line
and exit code 1; no traceback, no file written but the outputs, nothing left behind, the input
untouched.
Nothing is read short in silence: a witness that compares bytes says how many samples are owed
(`_fuzz_witness`); they are there, or a finding says that they are not.
Every third recording is treated as if it were large, with its columns in files.
Prints what happened by format.  Every case is made by the seed and its number alone:
``--case N --keep DIR`` makes one again.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Callable, Sequence
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
from typing import NamedTuple

from imu_bench.cli.main import main as imu_bench
from imu_bench.errors import RecordingError
from imu_bench.offline.recordings import cache
import numpy as np

from benchmarks._frame import Benchmark, cores
from benchmarks._fuzz_content import content, TWISTS
from benchmarks._fuzz_documents import DOCUMENTS
from benchmarks._fuzz_formats import analyze, Format, FORMATS
from benchmarks._fuzz_hostile import HOSTILE
from benchmarks._fuzz_witness import cut_within_a_row, owed, told

ALLOWED = ('result', 'error', 'not made')
KINDS: dict[str, Format] = {**FORMATS, **HOSTILE, **DOCUMENTS}
MEMORY = 1_000_000_000
_ADDRESSES = 4 << 30  # libraries and mapped files take some that are never touched
SECONDS = 30
_PATIENCE = 20.0 * SECONDS  # of a machine with much else to do, before a case counts as stuck
_LONGEST_LINE = 3000
_LATE = (
    'imu_bench.terminal.working', 'imu_bench.terminal.tables', 'imu_bench.cli.analyze',
    'imu_bench.cli.simulate', 'imu_bench.offline.analysis.recording',
    'imu_bench.offline.comparing.scales', 'imu_bench.offline.exports',
    'imu_bench.offline.presentation.pages', 'imu_bench.offline.recordings.arrays',
    'imu_bench.offline.recordings.bags', 'imu_bench.simulation.recording',
    'imu_bench.simulation.scenario', 'scipy.io', 'scipy.optimize', 'scipy.signal',
)  # fmt: skip
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


class Made(NamedTuple):
    """An input, the arguments of the command, and what a reader owes."""

    name: str
    arguments: list[str]
    owed: int
    cut: bool


def made(folder: Path, out: Path, seed: int, number: int) -> Made:
    """Write the input of a case."""
    rng = random.Random(f'{seed}-{number}')
    name = list(KINDS)[number % len(KINDS)]
    kind = KINDS[name]
    twist = rng.choice(('', '', *TWISTS)) if kind.counted else ''
    found = content(twist, np.random.default_rng([seed, number]))
    path = kind.write(folder, found)
    before = _contents(folder)
    if twist == '' or rng.random() < 0.3:
        kind.harm(sorted(file for file in folder.rglob('*') if file.is_file()), rng)
    arguments = [*kind.command(path, out, rng), *kind.options]
    if not kind.counted:
        return Made(name, arguments, 0, cut=False)
    after = _contents(folder)
    return Made(
        name,
        arguments,
        owed(before, after, kind.text),
        cut_within_a_row(before, after, kind.text),
    )


def _contents(folder: Path) -> dict[str, bytes]:
    return {
        str(file.relative_to(folder)): file.read_bytes()
        for file in folder.rglob('*')
        if file.is_file()
    }


def case(seed: int, number: int, home: str) -> Verdict:
    """Make an input, give it to a child, and judge what came of it."""
    with tempfile.TemporaryDirectory(dir=home) as place:
        folder = Path(place)
        for part in ('in', 'out', 'tmp', 'cwd'):
            (folder / part).mkdir()
        try:
            found = made(folder / 'in', folder / 'out', seed, number)
        except OverflowError:  # some writers refuse impossible stamps: then there is no recording
            return Verdict(number, list(KINDS)[number % len(KINDS)], 'not made', 0.0, 0, '')
        before = _digest(folder / 'in')
        child = os.fork()
        if child == 0:
            cache.LARGE = cache.LARGE if number % 3 else 1
            _run(folder, found.arguments)
        status, usage, late = _wait(child)
        took = usage.ru_utime + usage.ru_stime
        said = (folder / 'err').read_text('utf-8', 'replace')
        verdict = _judge(folder, status, late, said, found)
        if verdict in ('result', 'error') and usage.ru_maxrss * 1024 > MEMORY:
            verdict = f'took {usage.ru_maxrss >> 10} MB'
        if _digest(folder / 'in') != before:
            verdict = 'the input was changed'
        return Verdict(number, found.name, verdict, took, usage.ru_maxrss * 1024, said)


def _wait(child: int) -> tuple[int, resource.struct_rusage, bool]:
    ended = os.pidfd_open(child)
    try:
        late = not select.select([ended], [], [], _PATIENCE)[0]
        if late:
            os.kill(child, signal.SIGKILL)
        _, status, usage = os.wait4(child, 0)
    finally:
        os.close(ended)
    return status, usage, late


def _run(folder: Path, arguments: list[str]) -> None:
    """Run the command as a program of its own would run; does not return."""
    code = 70
    try:
        for stream, file in ((1, 'said'), (2, 'err')):
            os.dup2(os.open(folder / file, os.O_WRONLY | os.O_CREAT), stream)
        os.chdir(folder / 'cwd')
        os.environ['HOME'] = os.environ['TMPDIR'] = str(folder / 'tmp')
        tempfile.tempdir = None
        sys.dont_write_bytecode = True  # where it was imported for the first time
        resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 1))
        resource.setrlimit(resource.RLIMIT_AS, (_ADDRESSES, _ADDRESSES))
        sys.addaudithook(_watch(folder))
        code = imu_bench(arguments)
    except BaseException:  # whatever it is, this fork must not go on as its parent does
        sys.excepthook(*sys.exc_info())
    finally:
        sys.stderr.flush()
        os._exit(code)


def _watch(folder: Path) -> Callable[[str, tuple[object, ...]], None]:
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


def _judge(folder: Path, status: int, late: bool, said: str, made: Made) -> str:
    code = os.waitstatus_to_exitcode(status)
    # what `export` says of a recording that is not to be trusted
    lines = [line for line in said.splitlines() if not line.startswith('imu-bench: warning: ')]
    left = [str(file.relative_to(folder)) for part in ('tmp', 'cwd')
            for file in (folder / part).iterdir()]  # fmt: skip
    if late:
        return f'no end after {_PATIENCE:g} s'
    if code == -signal.SIGXCPU:
        return f'no end after {SECONDS} s of CPU time'
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
        return 'exit code 0 with an error' if lines else _result(folder / 'out', made)
    # one line for each recording that fails
    few = 1 <= len(lines) <= KINDS[made.name].recordings
    return 'error' if few else f'exit code 1 with {len(lines)} lines'


def _result(folder: Path, made: Made) -> str:
    from imu_bench.offline.analysis import results

    page, document = folder / 'r.html', folder / 'r.json'
    if page.exists() and '</html>' not in page.read_text('utf-8')[-100:]:
        return 'no whole report'
    if KINDS[made.name].command is not analyze:
        return 'result'
    try:
        found = results.read(document).recordings
    except RecordingError as problem:
        return f'a result that cannot be read: {problem}'
    if not (page.exists() and found and all(recording.axes for recording in found)):
        return 'empty result'
    stored = sum(recording.health.stored for recording in found)
    if not told(found) and (stored < made.owed or made.cut):
        return f'silent: {stored} of {made.owed} samples'
    return 'result'


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


def show(verdicts: Sequence[Verdict]) -> None:
    """Print what happened."""
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
    bad = [v for v in verdicts if v.verdict not in ALLOWED]
    for verdict in bad:
        print(f'\ncase {verdict.number} ({verdict.format}): {verdict.verdict}\n{verdict.said}')


def main() -> int:
    bench = Benchmark(__doc__)
    bench.add_size('--cases', 5000, quick=4, help='damaged inputs')
    bench.add_argument('--seed', type=int, default=1)
    bench.add_argument('--case', type=int, action='append', help='only this one (repeatable)')
    bench.add_argument('--keep', type=Path, help='write the recordings of the cases there')
    bench.add_argument('--jobs', type=int, default=cores())
    arguments = bench.start()
    cases = arguments.case or range(arguments.cases)
    if arguments.keep is not None:
        for number in cases:
            folder = arguments.keep / str(number)
            folder.mkdir(parents=True)
            found = made(folder, folder / 'out', arguments.seed, number)
            print(f'case {number} ({found.name}): imu-bench {" ".join(found.arguments)}')
        return 0
    print(f'\n{len(cases)} inputs of {len(KINDS)} kinds\n')
    verdicts = run(cases, arguments.seed, arguments.jobs)
    show(verdicts)
    allowed = Counter(verdict.verdict in ALLOWED for verdict in verdicts)
    bench.claim('cases that ended otherwise', allowed[False], at_most=0)
    return bench.done()


if __name__ == '__main__':
    sys.exit(main())
