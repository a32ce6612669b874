# SPDX-License-Identifier: Apache-2.0
"""A recording as a user makes it, its processes, and what it says at its end."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
import ctypes
import os
from pathlib import Path
import re
import resource
import signal
import subprocess
import sys
import time
from types import TracebackType

from imu_bench.account import BORDERS
import yaml

from benchmarks._measured import family

RECORDER, SENSORS, READING, ANALYSIS = 'recorder', 'sensors', 'reading', 'analysis'
_MODULES = {
    'imu_bench.nodes.recorder_node': RECORDER,
    'imu_bench.nodes.bench_node': SENSORS,
    'imu_bench.nodes.sensor_node': SENSORS,
    'imu_bench.live.reading_child': READING,
    'imu_bench.nodes.analysis_node': ANALYSIS,
}

UP_S = 180.0
"""So long a bench may take to come up beside eight busy loops on two cores."""

GOES_S = 60.0
"""So long after its time a recording may take to end."""

SETTLES_S = 3.0
"""So long what was told to end may take until it is gone."""

_BEGUN = re.compile(r'^\d+:\d\d:\d\d(?:,| of )', re.MULTILINE)
_SHARED = re.compile(r'/dev/shm/(fastrtps_\w+)')
_PR_CAPBSET_DROP, _CAP_SYS_NICE = 24, 23
"""linux/prctl.h, linux/capability.h."""


def generic_bench(folder: Path, rates: Sequence[float]) -> Path:
    """Write a bench of simulated sources, which lose nothing themselves; return its file."""
    entries = []
    for number, rate in enumerate(rates):
        noise = {'acceleration': {'noise_density': '100 µg/√Hz'}}
        sensor = {'driver': 'generic', 'backend': 'emulated', 'rate_hz': rate, 'simulation': noise}
        file = folder / f'source_{number}.yaml'
        file.write_text(
            yaml.safe_dump({'/**': {'ros__parameters': sensor}}, allow_unicode=True),
            encoding='utf-8',
        )
        entries.append({'file': file.name})
    bench = folder / 'sources.yaml'
    bench.write_text(yaml.safe_dump({'name': 'sources', 'sensors': entries}), encoding='utf-8')
    return bench


def without_rights() -> None:
    """Give up the right to real-time priority, as an ordinary user has none; before an exec."""
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    if os.geteuid() == 0:
        # from the bounding set: what is executed next does not get it back
        ctypes.CDLL(None).prctl(_PR_CAPBSET_DROP, _CAP_SYS_NICE, 0, 0, 0)


class Recording:
    """
    `imu-bench record`, or `demo`, in a process of its own; a context manager.

    Parameters
    ----------
    folder : Path
        Gets the bag and the output.
    bench : str
    seconds : float
    verb : {'record', 'demo'}
    bag : Path, optional
        Where else the bag goes; not with a demo.
    prepare : callable, optional
        Called in the new process before it is the program.
    environment : mapping of str to str, optional
        Variables that it has beside ours.
    more : sequence of str
        Further arguments.
    """

    def __init__(
        self, folder: Path, bench: str, seconds: float, *, verb: str = 'record',
        bag: Path | None = None, prepare: Callable[[], None] | None = None,
        environment: Mapping[str, str] | None = None, more: Sequence[str] = (),
    ) -> None:  # fmt: skip
        output = bag or folder / ('bag' if verb == 'record' else 'demo')
        self.bag = output if verb == 'record' else output / 'bag'
        self.seconds = seconds
        self._out, self._err = folder / 'stdout.txt', folder / 'stderr.txt'
        self._seen: dict[int, str] = {}
        self._shared: set[str] = set()
        self._before = {path.name for path in Path('/dev/shm').glob('fastrtps_*')}
        duration = f'{seconds:g}' + ('s' if verb == 'record' else '')
        command = [
            'imu_bench.cli.main',
            verb,
            bench,
            '-o',
            str(output),
            '--duration',
            duration,
            *more,
        ]
        with self._out.open('w') as out, self._err.open('w') as err:
            self._process = subprocess.Popen(
                [sys.executable, '-m', *command],
                stdin=subprocess.DEVNULL, stdout=out, stderr=err, preexec_fn=prepare,
                env={**os.environ, 'IMU_BENCH_LINE_EVERY_S': '0.4', **(environment or {})},
            )  # fmt: skip
        self.begun_s = 0.0

    def __enter__(self) -> Recording:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:  # fmt: skip
        """End what is left of it, however it went."""
        for pid in [self._process.pid, *self.left()]:
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        self._process.wait()

    # --- while it runs -------------------------------------------------------------------

    def wait_begun(self) -> None:
        """Wait until it records."""
        if not wait_for(lambda: self.code is not None or self._begun(), UP_S):
            raise TimeoutError(f'nothing recorded after {UP_S:g} s: {self.said()}')
        if self.code is not None and not self._begun():
            raise RuntimeError(f'ended with {self.code} before it recorded: {self.said()}')
        self.begun_s = time.monotonic()
        self.look()

    def _begun(self) -> bool:
        return _BEGUN.search(self._err.read_text('utf-8')) is not None

    @property
    def code(self) -> int | None:
        """Its exit code; None while it runs."""
        return self._process.poll()

    @property
    def pid(self) -> int:
        """Process id of the program that was started."""
        return self._process.pid

    def processes(self, role: str = '') -> list[int]:
        """Return those that run now, of one role or all."""
        return [pid for pid, own in self.look().items() if own == role or not role]

    def look(self) -> dict[int, str]:
        """Return the role of each process that runs now, and remember them."""
        running = {}
        for pid in family(self._process.pid):
            with suppress(OSError):
                words = Path(f'/proc/{pid}/cmdline').read_text('utf-8').split('\0')
                role = next((_MODULES[word] for word in words if word in _MODULES), '')
                running[pid] = role or ('session' if pid == self._process.pid else 'other')
                self._seen[pid] = _born(pid)
                maps = Path(f'/proc/{pid}/maps').read_text('utf-8')
                self._shared.update(_SHARED.findall(maps))
        return running

    def pass_time(self, until_s: float) -> bool:
        """Wait until so long after its begin; return False if it ended before."""
        left = self.begun_s + until_s - time.monotonic()
        wait_for(lambda: self.code is not None, left)
        self.look()
        return self.code is None

    def wait_ended(self, more_s: float = 0.0) -> float:
        """Wait for its end; return how many seconds after its time that was."""
        end = self.begun_s + self.seconds
        self.look()
        wait_for(lambda: self.code is not None, end + GOES_S + more_s - time.monotonic())
        return time.monotonic() - end

    # --- afterwards ----------------------------------------------------------------------

    def left(self) -> list[int]:
        """Return its processes that are still there."""
        return [pid for pid, born in self._seen.items() if born and _born(pid) == born]

    def problems(self, *, killed: bool = False) -> list[str]:
        """Return what it left behind and should not; what is killed leaves shared memory."""
        found = []
        if self.code is None:
            found.append(f'still there {GOES_S:g} s after its time')
        wait_for(lambda: not self.left(), SETTLES_S)
        if self.left():
            found.append(f'processes left: {", ".join(map(str, self.left()))}')
        segments = [
            name
            for name in self._shared - self._before
            if Path('/dev/shm', name).exists() and _ours(name)
        ]
        if segments and not killed:
            found.append(f'left in /dev/shm: {", ".join(sorted(segments))}')
        if 'Traceback' in self.said():
            found.append('a traceback')
        return found

    def said(self) -> str:
        """Return everything it printed."""
        return self._out.read_text('utf-8') + self._err.read_text('utf-8')

    def errors(self) -> list[str]:
        """Return the lines in which it says what is wrong."""
        return [line for line in self.said().splitlines() if line.startswith('imu-bench: error')]

    def lost(self) -> dict[str, dict[str, int]]:
        """Return what it says was lost, by sensor and border (`Border.short`)."""
        return lost_as_said(self._out.read_text('utf-8'))


def lost_as_said(text: str) -> dict[str, dict[str, int]]:
    """
    Return what the last lines of a recording say was lost, by sensor and border.

    Examples
    --------
    >>> lost_as_said('tilt: 1 995 messages, kept its rate, 1 008 lost: 1 003 in the sensor, '
    ...              '5 on the way to the recorder')
    {'tilt': {'sensor': 1003, 'way': 5}}
    >>> lost_as_said('tilt: 1 995 messages, kept its rate, nothing lost')
    {'tilt': {}}
    """
    found: dict[str, dict[str, int]] = {}
    for line in text.splitlines():
        name, _, rest = line.partition(': ')
        if not re.match(r'[\d\s]+ messages?\b', rest) or '/' in name:
            continue
        lost = {}
        for border in BORDERS:
            match = re.search(rf'(\d[\d\s]*?)\s(?:lost )?{border.where}', rest)
            if match:
                lost[border.short] = int(re.sub(r'\s', '', match[1]))
        found[name] = lost
    return found


def _ours(name: str) -> bool:
    """Return whether a segment is of our domain: ports of others are mapped as well."""
    match = re.fullmatch(r'fastrtps_port(\d+)', name)
    if match is None:
        return True
    # OMG DDSI-RTPS 2.5, 9.6.2.3: each domain has 250 ports from 7400 on
    return (int(match[1]) - 7400) // 250 == int(os.environ.get('ROS_DOMAIN_ID', '0'))


def wait_for(condition: Callable[[], bool], seconds: float) -> bool:
    """Look at a condition every 50 ms; return whether it came true in time."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() >= end:
            return False
        time.sleep(0.05)
    return True


def _born(pid: int) -> str:
    """Return when a process was started, '' if it has ended: numbers are used again."""
    try:
        fields = Path(f'/proc/{pid}/stat').read_text('utf-8').rpartition(')')[2].split()
    except OSError:
        return ''
    return '' if fields[0] == 'Z' else fields[19]
