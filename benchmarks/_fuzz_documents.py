# SPDX-License-Identifier: Apache-2.0
"""Documents that are no recordings: results in JSON, settings in YAML, and other verbs' inputs."""

from __future__ import annotations

from collections.abc import Callable
import copy
from functools import cache
import json
from pathlib import Path
import random
import tempfile
from typing import Any

from imu_bench.cli.export import FORMATS as EXPORTS
from imu_bench.offline.analysis import results
from imu_bench.offline.analysis.recording import analyse
from imu_bench.offline.analysis.results import Analysis
from imu_bench.offline.recordings import load_all, open_source
import numpy as np
import yaml

from benchmarks._fuzz_content import Content, content
from benchmarks._fuzz_damage import damaged
from benchmarks._fuzz_formats import Format, FORMATS

_ODD: tuple[Any, ...] = (
    None, True, False, 0, -1, 1e308, -1e308, 5e-324, 1 << 62, -(1 << 63), 1 << 64, '', 'x', 'm/s²',
    'Hz', '1 mg', '-3 °/s', '1e999 g', '9 h', 'nan', [], {}, [[]], [None], {'': None}, 'x' * 5000,
    '\x1b[2J\n', '/', '../../etc/passwd', [1e308] * 4, float('nan'), float('inf'), 10**400,
)  # fmt: skip
_SENSOR = """
/**:
  ros__parameters:
    driver: generic
    backend: emulated
    title: My IMU
    rate_hz: 200.0
    simulation:
      seed: 5
      rate_error: "0.4 %"
      acceleration:
        noise_density: "120 µg/√Hz"
        bias_instability: "40 µg"
        bias: ["5 mg", "-3 mg", "12 mg"]
      angular_velocity:
        noise_density: "0.007 °/s/√Hz"
        random_walk: "2 °/h/√h"
"""
_BENCH = """
name: one
title: One sensor
sensors:
  - file: sensor.yaml
recorder:
  storage: mcap
analysis:
  window_s: 600.0
tests:
  - name: static
    title: A night at rest
    scenarios: [still]
    duration: "8 h"
    plan: static
    short: {duration: "4 min"}
  - name: tilt
    scenarios: [tilt_steps]
    plan: inclination
    settings: {step: 0.58139 °}
    live: {set: ["tilt_steps.steps=3", "tilt_steps.dwell=7 s"]}
"""
_SCENARIO = """
title: A sine on noise
source: nobody
duration: "1 s"
zones:
  rest: "0.4 s"
  work: "0.6 s"
motions:
  - sine:
      axis: z
      frequency: "90 Hz"
      amplitude: "5 m/s²"
  - random:
      axis: x
      density: "2e-4 (m/s²)²/Hz"
      low: "5 Hz"
      high: "80 Hz"
"""
_SHEET = """
a:
  source: data sheet
  linear_acceleration: {noise_density: 120 µg/√Hz, bias_instability: [1 mg, 2 mg, 3 mg]}
  angular_velocity: {noise_density: 0.007 °/s/√Hz}
"""

# --- harm to a tree of values --------------------------------------------------------------------


def _places(document: Any) -> list[tuple[Any, Any]]:
    """Return every container of a document with every key in it."""
    found, waiting = [], [document]
    while waiting:
        node = waiting.pop()
        pairs = node.items() if isinstance(node, dict) else enumerate(node)
        for key, value in pairs:
            found.append((node, key))
            if isinstance(value, (dict, list)):
                waiting.append(value)
    return found


def _changed(document: Any, rng: random.Random) -> Any:
    """Return a copy of which some nodes are gone, odd, twice there, renamed or exchanged."""
    document = copy.deepcopy(document)
    for _ in range(rng.choice((1, 1, 1, 3, 20))):
        places = _places(document)
        if not places:
            break
        (node, key), (other, of) = rng.choice(places), rng.choice(places)
        way = rng.random()
        if way < 0.2:
            del node[key]
        elif way < 0.3 and isinstance(node, dict):
            node[rng.choice(('', 'x', 'B', of, 7, None))] = node.pop(key)
        elif way < 0.4 and isinstance(node, list):
            node.extend(copy.deepcopy(node[key]) for _ in range(rng.choice((1, 5000))))
        elif way < 0.5:
            node[key] = copy.deepcopy(other[of])
        elif way < 0.55:
            for _ in range(rng.choice((30, 90))):  # deeper than that yaml cannot write
                node[key] = rng.choice(([node[key]], {'x': node[key]}))
        else:
            node[key] = copy.deepcopy(rng.choice(_ODD))
    return document


# --- results -------------------------------------------------------------------------------------


@cache
def _result() -> dict[str, Any]:
    """Return a result of ten seconds of a still sensor, as `analyze --json` writes it."""
    with tempfile.TemporaryDirectory() as folder:
        path = FORMATS['native CSV'].write(Path(folder), content('', np.random.default_rng(1)))
        with open_source(path) as source:
            [recording] = load_all(source, source.select())
            found = analyse(recording)
        results.write(Analysis((found,)), Path(folder) / 'a.json')
        return dict(json.loads((Path(folder) / 'a.json').read_text('utf-8')))


def _write_result(folder: Path, sound: Content) -> Path:
    for name in ('a.json', 'b.json'):
        (folder / name).write_text(json.dumps(_result(), ensure_ascii=False), 'utf-8')
    return folder / 'b.json'


def _harm_result(files: list[Path], rng: random.Random) -> None:
    file = files[-1]
    way = rng.random()
    if way < 0.15:
        file.write_bytes(damaged(file.read_bytes(), rng))
    elif way < 0.25:
        words = ('[' * 100_000, '{"a":' * 100_000, '[' + '[],' * 3_000_000 + '0]', '9' * 9999, '',
                 'null', '[]', '"' + 'x' * 10_000_000 + '"', '{}', '\ufeff{}', '\0')  # fmt: skip
        file.write_text(rng.choice(words), 'utf-8')
    elif way < 0.35:  # deep, huge or odd below something that is there
        others = ('[' * 3000 + ']' * 3000, '1' * 5000, '1e999', 'NaN', '"\\ud800"',
                 '[' + '0,' * 500_000 + '0]')  # fmt: skip
        text = json.dumps(_changed(_result(), rng) | {'settings': '@'}, ensure_ascii=False)
        file.write_text(text.replace('"@"', rng.choice(others)), 'utf-8', 'surrogatepass')
    else:
        file.write_text(json.dumps(_changed(_result(), rng)), 'utf-8')


def _compare(path: Path, out: Path, rng: random.Random) -> list[str]:
    both = [str(path.with_name('a.json')), str(path)]
    rng.shuffle(both)
    return ['compare', *both, '--json', str(out / 'r.json'), '--html', str(out / 'r.html')]


def _export(path: Path, out: Path, rng: random.Random) -> list[str]:
    more = rng.choice(([], ['--conservative'], ['--topic', 'a']))
    return ['export', str(path), '--to', rng.choice(EXPORTS), '-o', str(out / 'r.txt'), *more]


def _twins(path: Path, out: Path, rng: random.Random) -> list[str]:
    return ['simulate', '--from', str(path), '--duration', '200ms', '-o', str(out / 'bag')]


# --- settings ------------------------------------------------------------------------------------


def _write_bench(folder: Path, sound: Content) -> Path:
    for name, text in (('bench', _BENCH), ('scenario', _SCENARIO), ('sensor', _SENSOR)):
        (folder / f'{name}.yaml').write_text(text, 'utf-8')
    return folder / 'bench.yaml'


def _write_sheet(folder: Path, sound: Content) -> Path:
    (folder / 'sheet.yaml').write_text(_SHEET, 'utf-8')
    return FORMATS['native CSV'].write(folder, sound)


def _write_metadata(folder: Path, sound: Content) -> Path:
    return FORMATS['sqlite3'].write(folder, sound)


def _laughs(rng: random.Random) -> str:
    """Return YAML that grows: lists of lists of aliases, merged or within themselves."""
    levels, width = rng.choice(((9, 10), (30, 2), (60, 1), (4, 1000)))
    lines = ['a0: &a0 ' + rng.choice(('x', '{x: 1}', '[x, x]', '[]'))]
    for level in range(1, levels):
        inside = ', '.join([f'*a{level - 1}'] * width)
        lines.append(f'a{level}: &a{level} [{inside}]')
    if rng.random() < 0.3:
        lines.append(rng.choice(('c: &c {d: *c}', f'm: {{<<: [{inside}]}}', 'c: &c [*c, *c]')))
    return '\n'.join([*lines, ''])


def _harm_yaml(name: str) -> Callable[[list[Path], random.Random], None]:
    def harm(files: list[Path], rng: random.Random) -> None:
        file = next(file for file in files if file.name == f'{name}.yaml')
        text, way = file.read_text('utf-8'), rng.random()
        if way < 0.3:
            file.write_bytes(damaged(text.encode(), rng))
        elif way < 0.4:
            file.write_text(text + _laughs(rng), 'utf-8')
        elif way < 0.5:
            found = yaml.safe_load(text)
            node, key = rng.choice(_places(found))
            node[key] = '@@'
            bad = ('[' * 5000, '[' * 300 + ']' * 300, '{a: ' * 200, '- ' * 900, '7' * 5000,
                   '2001-13-45', '!!binary x', '!!python/object:os.system x', '0x' + 'f' * 5000,
                   '*nobody', '&a [*a]', '1:' * 500 + '1', '.inf', '!!set {a, b}')  # fmt: skip
            grown = yaml.safe_dump(found, allow_unicode=True, sort_keys=False)
            file.write_text(grown.replace("'@@'", rng.choice(bad)), 'utf-8')
        else:
            found = _changed(yaml.safe_load(text), rng)
            file.write_text(yaml.safe_dump(found, allow_unicode=True, sort_keys=False), 'utf-8')

    return harm


def _simulate(path: Path, out: Path, rng: random.Random) -> list[str]:
    scenario = ['--scenario', str(path.with_name('scenario.yaml'))]
    return ['simulate', str(path), *scenario, '--duration', '200ms', '-o', str(out / 'bag')]


def _campaign(path: Path, out: Path, rng: random.Random) -> list[str]:
    return ['campaign', str(path), '--list']


def _with_sheet(path: Path, out: Path, rng: random.Random) -> list[str]:
    sheet = str(path.with_name('sheet.yaml'))
    return ['analyze', str(path), '--jobs', '1', '--datasheet', sheet]


def _with_plan(path: Path, out: Path, rng: random.Random) -> list[str]:
    """Analyse a sound recording by a plan with odd settings."""
    settings = [f'{rng.choice(("segments", "confidence", "x", "step"))}={rng.choice(_ODD)}'
                for _ in range(rng.choice((0, 1, 2)))]  # fmt: skip
    given = [part for setting in settings for part in ('--set', setting)]
    plan = rng.choice(('static', 'inclination', 'thermal', 'vibration', 'six_position'))
    return ['analyze', str(path), '--jobs', '1', '--plan', plan, *given]


_DOCUMENT: dict[str, Any] = {'counted': False}
DOCUMENTS: dict[str, Format] = {
    'result for compare': Format(
        _write_result, harm=_harm_result, command=_compare, **_DOCUMENT),
    'result for export': Format(_write_result, harm=_harm_result, command=_export, **_DOCUMENT),
    'result for simulate': Format(
        _write_result, harm=_harm_result, command=_twins, **_DOCUMENT),
    'YAML of a sensor': Format(
        _write_bench, harm=_harm_yaml('sensor'), command=_simulate, **_DOCUMENT),
    'YAML of a bench': Format(
        _write_bench, harm=_harm_yaml('bench'), command=_simulate, **_DOCUMENT),
    'YAML of tests': Format(
        _write_bench, harm=_harm_yaml('bench'), command=_campaign, **_DOCUMENT),
    'YAML of a scenario': Format(
        _write_bench, harm=_harm_yaml('scenario'), command=_simulate, **_DOCUMENT),
    'YAML of data sheets': Format(
        _write_sheet, harm=_harm_yaml('sheet'), command=_with_sheet, **_DOCUMENT),
    'settings of a plan': Format(
        FORMATS['native CSV'].write, harm=lambda files, rng: None, command=_with_plan,
        **_DOCUMENT),
    'metadata of a bag': Format(_write_metadata, harm=_harm_yaml('metadata')),
}  # fmt: skip
