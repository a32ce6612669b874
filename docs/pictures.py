# SPDX-License-Identifier: Apache-2.0
"""
`python docs/pictures.py` draws the pictures of the pages anew, into docs/images.

That of the report is the first screen of what these commands make, taken by Chromium:

    imu-bench simulate machine_vibration --duration 20min -o six
    imu-bench analyze six --html report.html
"""

from __future__ import annotations

import math
from pathlib import Path
import shutil
import subprocess
from tempfile import TemporaryDirectory

import imu_bench as ib
from imu_bench.cli.main import main
from imu_bench.simulation.noise import Flicker, RandomWalk, White
from matplotlib.figure import Figure
import numpy as np

IMAGES = Path(__file__).resolve().parent / 'images'

N, B, K = 0.005, 5.0 / 3600.0, 12.0 / 3600.0 / 60.0
"""°/s/√Hz (two-sided, of the Allan deviation), °/s, °/s/√s: a gyroscope of a few euros."""

RATE_HZ, HOURS = 10.0, 8.0


def allan_deviation() -> Figure:
    """Return the curve of a simulated gyroscope, and the parts it is the sum of."""
    n = round(HOURS * 3600.0 * RATE_HZ)
    made = ((White, math.sqrt(2.0) * N), (Flicker, B), (RandomWalk, K))
    seeds = np.random.default_rng(7).spawn(len(made))
    rate = sum(
        kind(size, seed).sample(n, 1.0 / RATE_HZ)
        for (kind, size), seed in zip(made, seeds, strict=True)
    )
    curve = ib.oadev(rate, RATE_HZ, unit='deg/s')
    figure = Figure(figsize=(7.0, 4.2), layout='constrained', dpi=130)
    axes = figure.subplots()
    axes.fill_between(curve.tau, curve.low, curve.high, color='#9ec5e8', label='95 % interval')
    axes.loglog(curve.tau, curve.deviation, color='#12518a', label='measured in a night')
    # IEEE Std 952-1997, annex C
    floor = B * math.sqrt(2.0 * math.log(2.0) / math.pi)
    parts = {
        'N: white noise, −1/2': N / np.sqrt(curve.tau),
        'B: flicker, flat at 0.664 B': np.full_like(curve.tau, floor),
        'K: rate random walk, +1/2': K * np.sqrt(curve.tau / 3.0),
    }
    for (label, part), dash in zip(parts.items(), ('--', '-.', ':'), strict=True):
        axes.loglog(curve.tau, part, dash, color='#55606b', linewidth=1.0, label=label)
    axes.set(xlabel='averaging time τ in s', ylabel='Allan deviation σ(τ) in °/s',
             ylim=(curve.low.min() / 2, curve.high.max() * 1.5))  # fmt: skip
    axes.grid(which='major', color='#dde2e8')
    axes.legend(frameon=False, fontsize=9)
    return figure


def report(target: Path, browser: str) -> None:
    """Write the first screen of the report on six simulated sensors as a browser shows it."""
    with TemporaryDirectory() as folder:
        bag, page = Path(folder, 'six'), Path(folder, 'report.html')
        commands = (
            ('simulate', 'machine_vibration', '--duration', '20min', '-o', str(bag)),
            ('analyze', str(bag), '--html', str(page)),
        )
        for command in commands:
            if main(list(command)) != 0:
                raise SystemExit(f'imu-bench {" ".join(command)} failed')
        options = ('--headless', '--no-sandbox', '--hide-scrollbars', '--window-size=1180,1000')
        shot = (browser, *options, f'--screenshot={target}', page.as_uri())
        subprocess.run(shot, check=True, timeout=60.0)


if __name__ == '__main__':
    chromium = shutil.which('chromium') or shutil.which('google-chrome')
    if chromium is None:
        raise SystemExit('the picture of the report needs chromium: apt install chromium')
    report(IMAGES / 'report.png', chromium)
    allan_deviation().savefig(IMAGES / 'allan_deviation.png', metadata={'Software': None})
