# SPDX-License-Identifier: Apache-2.0
"""Many records in parts: what is done is kept in a file, and the same command goes on."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from concurrent.futures import as_completed, Future, ProcessPoolExecutor
from hashlib import sha256
import json
from pathlib import Path
import sys
import time
from typing import Any

from benchmarks._frame import Benchmark, cores

ROOT = Path(__file__).resolve().parent.parent

Key = tuple[Any, ...]
"""What a record is made from: texts and numbers, the seed among them."""


class Parts:
    """
    Work on records that may be spread over several runs.

    Parameters
    ----------
    bench : Benchmark
        Gets the options ``--keep`` and ``--stop-after``.
    """

    def __init__(self, bench: Benchmark) -> None:
        bench.add_argument(
            '--keep', type=Path, metavar='FILE',
            help='keep what each record gave there; records that are there are not made again',
        )  # fmt: skip
        bench.add_argument(
            '--stop-after',
            type=float,
            metavar='SECONDS',
            help='begin no record after so long; with --keep, the same command goes on',
        )

    def run(self, options: Any, work: Callable[..., Any], keys: Iterable[Key]) -> dict[Key, Any]:
        """
        Return what `work` gives for every key, as it comes out of JSON.

        The program ends here, with exit code 3, if time is up before all are done.
        """
        self._file: Path | None = options.keep
        keys = list(dict.fromkeys(keys))
        done = self._kept()
        left = iter([key for key in keys if key not in done])
        began = time.monotonic()
        stop_s = options.stop_after
        with ProcessPoolExecutor(cores()) as pool:
            running: dict[Future[Any], Key] = {}
            while True:
                in_time = stop_s is None or time.monotonic() - began < stop_s
                while in_time and len(running) < 2 * cores() and (key := next(left, None)):
                    running[pool.submit(work, *key)] = key
                if not running:
                    break
                future = next(as_completed(running))
                key = running.pop(future)
                done[key] = self._keep(key, future.result())
        missing = sum(key not in done for key in keys)
        if missing:
            print(f'\n{missing} of {len(keys)} records are left; the same command goes on')
            sys.exit(3)
        return {key: done[key] for key in keys}

    def _kept(self) -> dict[Key, Any]:
        """Return what the file has, which only the same code may have written."""
        if self._file is None:
            return {}
        if not self._file.exists():
            self._file.write_text(json.dumps(source()) + '\n', 'utf-8')
            return {}
        lines = self._file.read_text('utf-8').splitlines()
        if json.loads(lines[0]) != source():
            sys.exit(f'--keep {self._file}: from other code than this; take another file')
        return {tuple(key): found for key, found in map(json.loads, lines[1:])}

    def _keep(self, key: Key, found: Any) -> Any:
        line = json.dumps([key, found])
        if self._file is not None:
            with self._file.open('a', encoding='utf-8') as file:
                file.write(line + '\n')
        return json.loads(line)[1]


def source() -> str:
    """Return a digest of everything that decides what a record gives."""
    files = [p for folder in ('imu_bench', 'benchmarks') for p in (ROOT / folder).rglob('*.py')]
    whole = sha256()
    for path in sorted(files):
        whole.update(str(path.relative_to(ROOT)).encode() + path.read_bytes())
    return whole.hexdigest()
