# SPDX-License-Identifier: Apache-2.0
"""`imu-bench doctor`: what this machine, and a bench on it, lacks."""

from __future__ import annotations

import argparse
import getpass
import json
import math
import os
from pathlib import Path
import shutil
import sys
from typing import TYPE_CHECKING

from imu_bench.errors import ConfigError
from imu_bench.terminal.arguments import duration

if TYPE_CHECKING:
    from imu_bench.config import BenchConfig
    from imu_bench.doctor.checkup import Checkup
    from imu_bench.doctor.load import BusLoad, Share
    from imu_bench.doctor.resting import Row
    from rich.console import Console
    from rich.table import Table

DONE, FAULT = 0, 1
FULL = 0.8
"""A bus that is busier has no room for a late thread."""


def register(verbs: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the verb to the command line."""
    parser = verbs.add_parser(
        'doctor',
        help='buses, permissions, who answers; for a bench: what is missing, load of each bus',
        description='Looks at this machine and says what to do about what is missing. With a '
        'bench it also predicts the load of each bus and the rates that come out. Registers are '
        'only read, never written: identity registers, at the addresses the drivers know. Only '
        '--check starts the sensors.',
    )
    parser.add_argument(
        'bench', nargs='?', help='a bench of config/benches or a YAML, also of one sensor'
    )
    parser.add_argument('--json', action='store_true', help='for machines')
    parser.add_argument(
        '--i2c-hz', type=_hertz, default=0.0, metavar='HZ',
        help='clock of every I²C bus (default: as the device tree says)',
    )  # fmt: skip
    parser.add_argument('--no-probe', action='store_true', help='do not look for unknown chips')
    parser.add_argument(
        '--check', action='store_true',
        help='let the bench stand still for a minute: are gravity, noise and rates right?',
    )  # fmt: skip
    parser.add_argument(
        '--duration', type=duration, default=60.0, metavar='T',
        help='how long it stands still for --check (default 60s)',
    )  # fmt: skip
    parser.add_argument(
        '--setup', action='store_true',
        help='print the files that this computer needs: permissions, limits; with a bench also '
        'its buses, and a unit that records it from the start of the computer on',
    )  # fmt: skip
    parser.add_argument(
        '--apply', action='store_true', help='with --setup: write them, and say what to do next'
    )
    parser.add_argument(
        '--root', type=Path, default=Path('/'), metavar='DIR',
        help='with --apply: below this folder',
    )  # fmt: skip
    parser.add_argument(
        '--user', metavar='NAME', help='with --setup: who records (default who asks)'
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Examine; return 1 if something that the bench needs is missing."""
    from imu_bench.bench import load_bench
    from imu_bench.config.location import config_file
    from imu_bench.doctor.checkup import examine

    config = None
    if args.check and not args.bench:
        raise ConfigError('check what? Give a bench: imu-bench doctor --check BENCH')
    if args.bench:
        name = args.bench if args.bench.endswith('.yaml') else f'benches/{args.bench}.yaml'
        config = load_bench(config_file(name))
    if args.setup:
        return _setup(config, args)
    if args.check and config is not None:
        return _check(config, args)
    found = examine(config, i2c_hz=args.i2c_hz, probe=not args.no_probe)
    if args.json:
        print(json.dumps(found.as_json(), ensure_ascii=False, indent=2, allow_nan=False))
    else:
        _show(found)
    return DONE if found.ok else FAULT


def _setup(config: BenchConfig | None, args: argparse.Namespace) -> int:
    from imu_bench.config.location import config_file
    from imu_bench.doctor import setup

    user = args.user or os.environ.get('SUDO_USER') or getpass.getuser()
    name = args.bench or ''
    if name.endswith('.yaml'):
        name = str(config_file(name).resolve())
    command = shutil.which('imu-bench') or str(Path(sys.executable).with_name('imu-bench'))
    found = setup.files(config, name, user, command)
    if not args.apply:
        for path, text in found.items():
            print(f'# --- {args.root / path}\n{text}')
        print('# --- afterwards')
    else:
        for changed in setup.write(found, args.root):
            print(f'wrote {changed}')
        print('now say:')
    print('\n'.join(setup.afterwards(found)))
    return DONE


def _check(config: BenchConfig, args: argparse.Namespace) -> int:
    from imu_bench.doctor.resting import as_json, check

    if not args.json and any(sensor.backend == 'hardware' for sensor in config.sensors):
        print(f'{config.name} stands still for {args.duration:g} s', file=sys.stderr, flush=True)
    rows = check(config, args.duration)
    document = as_json(config.name, rows)
    if args.json:
        print(json.dumps(document, ensure_ascii=False, indent=2, allow_nan=False))
    else:
        _show_rows(rows)
    return DONE if document['ok'] else FAULT


def _show_rows(rows: list[Row]) -> None:
    from imu_bench.offline.notation import text
    from imu_bench.terminal.tables import console

    out = console()
    table = _table('At rest', 'sensor', 'what', '', 'measured', 'expected')
    for row in rows:
        verdict = row.verdict.upper() if row.verdict == 'wrong' else row.verdict
        measured = text(row.measured) if row.measured.observable else ''
        table.add_row(row.sensor, row.what, verdict, measured, row.expected)
    out.print(table)
    for row in rows:
        if row.advice:
            _say(out, f'{row.sensor}, {row.what}: {row.advice}.')


def _hertz(text: str) -> float:
    value = float(text)
    if not 1e3 <= value <= 5e6:
        raise argparse.ArgumentTypeError(f'{text} Hz is not between 1000 and 5000000')
    return value


def _show(found: Checkup) -> None:
    from imu_bench.terminal.tables import console

    out = console()
    _machine(found, out)
    if found.asked:
        _answers(found, out)
    if found.sensors:
        _sensors(found, out)
    slow = {sensor.name for sensor in found.sensors if sensor.warnings}
    for load in found.loads:
        _load(load, slow, out)
    if sum(load.name.startswith('emulated') for load in found.loads) > 1:
        _say(
            out, 'Emulated sensors that name no bus have a wire each; bus: i2c-1 makes them share.'
        )


def _machine(found: Checkup, out: Console) -> None:
    if not found.buses:
        _say(out, 'No I²C, SPI or serial bus on this machine: sensors can only be emulated here.')
    else:
        table = _table('Buses', 'device', 'adapter', 'group', 'this user', 'clock')
        for bus in found.buses:
            speed = f'{bus.speed_hz / 1e3:g} kHz' if bus.speed_hz else ''
            allowed = 'may use it' if bus.accessible else 'may NOT open it'
            table.add_row(bus.device, bus.adapter, bus.group, allowed, speed)
        out.print(table)
    for device, called in found.kernel.items():
        _say(out, f'{device}: the kernel reads a {called}; "driver: iio" takes it from there.')
    for bus in found.buses:
        if bus.advice:
            _say(out, f'{bus.device}: {bus.advice}')
    for advice in found.lacking:
        _say(out, f'{advice[0].upper()}{advice[1:]}.')
    _say(out, f'Threads that read a sensor: {found.scheduling}.')
    if found.scheduling_advice:
        _say(out, f'  Against losses when the machine is busy: {found.scheduling_advice}.')


def _answers(found: Checkup, out: Console) -> None:
    if not found.answers:
        _say(out, 'Nothing answers that a driver knows.')
        return
    table = _table('Who answers', 'device', 'address', 'what', 'drivers')
    for answer in found.answers:
        address = '' if answer.address is None else f'0x{answer.address:02X}'
        table.add_row(answer.device, address, answer.what, ', '.join(answer.drivers))
    out.print(table)


def _sensors(found: Checkup, out: Console) -> None:
    table = _table('Sensors of the bench', 'sensor', 'behind it', '', 'found')
    for sensor in found.sensors:
        table.add_row(sensor.name, sensor.label, 'ok' if sensor.ok else 'MISSING', sensor.found)
    out.print(table)
    for sensor in found.sensors:
        for warning in sensor.warnings:
            _say(out, f'{sensor.name}: {warning}.')


def _load(load: BusLoad, stretching: set[str], out: Console) -> None:
    speed = (
        f'{load.speed_hz / 1e3:g} kHz' if load.kind != 'serial' else f'{load.speed_hz:.0f} baud'
    )
    if load.speed_source == 'USB':
        speed = 'full speed'
    title = (
        f'{load.name}, {speed} ({load.speed_source}): busy {100 * load.busy:.0f} %, '
        f'{load.bytes_per_s:.0f} bytes/s'
    )
    table = _table(
        title, 'sensor', 'rate Hz', 'predicted', 'read every', 'bytes/s', 'busy', 'FIFO'
    )
    for share in load.shares:
        table.add_row(*_cells(share))
    out.print(table)
    for share in load.shares:
        if not share.keeps_rate:
            _say(out, f'{share.name} does NOT keep its rate on this bus.')
    if load.kind == 'i2c' and load.busy > FULL:
        _say(out, _relief(load, stretching & {share.name for share in load.shares}))


def _relief(load: BusLoad, stretching: set[str]) -> str:
    from imu_bench.doctor.checkup import FAST_I2C_HZ

    if stretching:
        return (
            f'Give {" and ".join(sorted(stretching))} its serial line: it holds the clock after '
            'every byte, so that no speed helps.'
        )
    if load.speed_hz >= FAST_I2C_HZ:
        return 'Put a sensor on another bus, on SPI, or lower a rate.'
    return (
        'Faster: dtparam=i2c_arm=on,i2c_arm_baudrate=400000 in /boot/firmware/config.txt, then '
        'restart.'
    )


def _cells(share: Share) -> tuple[str, ...]:
    if not share.has_fifo:
        depth = 'none'
    elif math.isinf(share.depth_s):
        depth = 'over 2 s'
    else:
        depth = f'{1e3 * share.depth_s:.0f} ms'
    return (
        share.name, f'{share.nominal_hz:g}', f'{share.predicted_hz:.4g}',
        f'{1e3 * share.look_period_s:.3g} ms', f'{share.bytes_per_s:.0f}',
        f'{100 * share.busy:.1f} %', depth,
    )  # fmt: skip


def _table(title: str, *columns: str) -> Table:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(title, style='bold'), title_justify='left', box=box.SIMPLE_HEAD,
        pad_edge=False, padding=(0, 1),
    )  # fmt: skip
    for name in columns:
        right = name in ('rate Hz', 'predicted', 'read every', 'bytes/s', 'busy', 'FIFO', 'clock')
        table.add_column(name, justify='right' if right else 'left')
    return table


def _say(out: Console, words: str) -> None:
    from imu_bench.counting import clean
    from rich.text import Text

    out.print(Text(clean(words)))
