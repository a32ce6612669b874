# SPDX-License-Identifier: Apache-2.0
"""What the file of an emulated sensor may say about how the sensor errs."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf
from typing import NamedTuple

from imu_bench.config.faults import FAULTS
from imu_bench.config.schema import Setting

_POSITIVE = (0.0, inf)


class _Units(NamedTuple):
    """Units of one quantity's errors; empty where it has no such error."""

    quantity: str
    signal: str
    density: str
    per_kelvin: str
    walk: str = ''
    quantisation: str = ''
    rectification: str = ''


_QUANTITIES = (
    _Units('acceleration', 'm/s²', 'm/s²/√Hz', 'm/s²/K', 'm/s²/√s', 'm/s', 'm/s²/(m/s²)²'),
    _Units(
        'angular_velocity', 'rad/s', 'rad/s/√Hz', 'rad/s/K', 'rad/s/√s', 'rad', 'rad/s/(m/s²)²'
    ),
    _Units('magnetic_field', 'T', 'T/√Hz', 'T/K'),
    _Units('temperature', 'K', 'K/√Hz', ''),
)


def _quantity(
    name: str,
    description: str,
    unit: str,
    bounds: tuple[float, float] | None = None,
    default: tuple[float, ...] | None = None,
) -> Setting:
    return Setting(f'simulation.{name}', default, description, (), bounds, unit, 'quantity')


def _errors_of(units: _Units) -> Iterator[Setting]:
    """Yield the settings of the error model of one quantity, all optional."""
    name, signal, some = units.quantity, units.signal, _POSITIVE
    yield _quantity(f'{name}.noise_density', 'White noise.', units.density, some)
    yield Setting(
        f'simulation.{name}.noise_type', 'one-sided', 'How the noise density is counted.',
        ('one-sided', 'two-sided'),
    )  # fmt: skip
    yield _quantity(f'{name}.bias_instability', 'Allan floor / 0.664.', signal, some)
    if units.walk:
        yield _quantity(f'{name}.random_walk', 'Rate random walk K.', units.walk, some)
        yield _quantity(f'{name}.quantisation', 'Q.', units.quantisation, some)
    yield _quantity(f'{name}.bias', 'Constant offset.', signal)
    yield _quantity(f'{name}.turn_on_bias', 'Offset drawn per run, σ.', signal, some)
    if units.per_kelvin:
        yield _quantity(f'{name}.temperature_bias', 'Offset per K from 25 °C.', units.per_kelvin)
        yield _quantity(f'{name}.temperature_scale', 'Scale per K from 25 °C.', '1/K')
        yield _quantity(f'{name}.scale_factor', 'Relative error of the scale.', '1')
        yield _quantity(f'{name}.misalignment', 'Rotation of the axes.', 'rad')
        yield from _rows(f'{name}.cross_axis', 'Share of true x, y, z in output', '1')
    if name == 'angular_velocity':
        text = 'Sensitivity to acceleration along x, y, z of output'
        yield from _rows(f'{name}.acceleration_bias', text, 'rad/s/(m/s²)')
    if units.rectification:
        yield _quantity(
            f'{name}.vibration_rectification', 'Offset by vibration.', units.rectification
        )
    yield _quantity(f'{name}.low_pass', 'Corner of its own filter.', 'Hz', (1e-6, inf))
    yield Setting(f'simulation.{name}.low_pass_order', 1, 'Butterworth.', (1, 2))
    yield Setting(
        f'simulation.{name}.low_pass_kind', 'analogue', 'Before sampling, or of the samples.',
        ('analogue', 'digital'),
    )  # fmt: skip
    yield _quantity(f'{name}.high_pass', 'No constant below this.', 'Hz', some)
    yield _quantity(f'{name}.range', 'Saturation.', signal, some)
    yield _quantity(f'{name}.resolution', 'Smallest step.', signal, some)
    yield _quantity(f'{name}.outlier_rate', 'Spikes per second.', 'Hz', some)
    yield _quantity(f'{name}.outlier_size', 'Largest spike.', signal, some)
    yield _quantity(f'{name}.zeros', 'Share of samples that read zero.', '1', (0.0, 1.0))
    yield _quantity(f'{name}.stuck_rate', 'Begins to stand still.', 'Hz', some)
    yield _quantity(f'{name}.stuck_time', 'Stands still for so long.', 's', some)
    if units.per_kelvin:
        yield Setting(f'simulation.{name}.axes', 'xyz', 'Axes there are; the others are NaN.')


def _rows(name: str, description: str, unit: str) -> Iterator[Setting]:
    for axis in 'xyz':
        yield _quantity(f'{name}.{axis}', f'{description} {axis}.', unit)


SIMULATION_SETTINGS = (
    Setting('simulation.seed', 0, 'Seed; each sensor draws a stream.', bounds=(0, 2**31 - 1)),
    Setting('simulation.scenario', 'still', 'How the bench moves: a scenario or its file.'),
    Setting(
        'simulation.begin',
        0.0,
        'Unix time at which it begins to move; 0 as it is switched on.',
        bounds=(0.0, 1e10),
        unit='s',
        changes=True,
    ),
    FAULTS,
    _quantity('rate_error', "Error of the chip's oscillator.", '1', (-0.2, 0.2), (0.0,)),
    _quantity('roll', 'Tilt of the sensor on the bench about x.', 'rad', default=(0.0,)),
    _quantity('pitch', 'Tilt of the sensor on the bench about y.', 'rad', default=(0.0,)),
    _quantity('self_heating', 'Warmer than the bench when warm.', 'K', default=(0.0,)),
    _quantity('warm_up', 'Time constant of that.', 's', (1e-3, inf), (60.0,)),
    *(setting for units in _QUANTITIES for setting in _errors_of(units)),
)
"""What an emulated sensor's file may set; errors not given are the driver's typical values."""
