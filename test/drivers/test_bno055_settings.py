# SPDX-License-Identifier: Apache-2.0
"""The settings of the BNO055 that go together."""

from imu_bench.bus.scripted import ScriptedRegisters
from imu_bench.drivers.bno055 import Bno055
from imu_bench.errors import ConfigError
from imu_bench.simulation.clock import SimulatedClock
import pytest


@pytest.mark.parametrize(
    ('settings', 'text'),
    [
        ({'mode': 'magonly'}, 'mode.*acconly'),
        ({'mode': 'm4g'}, r'rate_hz: mode m4g has 50 Hz'),
        ({'mode': 'amg', 'rate_hz': 50.0}, r'rate_hz: mode amg has 100 Hz'),
        ({'accelerometer_bandwidth': 125.0}, 'accelerometer_bandwidth: mode ndof has 62.5 Hz'),
        ({'gyroscope_bandwidth': 47.0}, 'gyroscope_bandwidth: mode ndof has 32 Hz'),
        ({'magnetometer_rate_hz': 10.0}, 'magnetometer_rate_hz: mode ndof has 20 Hz'),
        ({'accelerometer_range': 3.0}, '2, 4, 8, 16'),
        (
            {'magnetometer_mode': 'enhanced'},
            'mode ndof has regular and no other',
        ),
        ({'mode': 'amg', 'calibration_file': 'a'}, 'calibration_file: mode amg has none'),
        ({'magnetometer_mode': 'best'}, 'low power, regular, enhanced, high accuracy'),
    ],
)
def test_what_cannot_be_is_refused(settings, text):
    with pytest.raises(ConfigError, match=text):
        Bno055(ScriptedRegisters(()), SimulatedClock(), settings)


# DS table 3-14: the slowest of what a mode fuses, and the magnetometer
@pytest.mark.parametrize(
    ('mode', 'rate_hz', 'field_hz'),
    [('compass', 20.0, 20.0), ('m4g', 50.0, 50.0), ('ndof_fmc_off', 100.0, 20.0),
     ('ndof', 100.0, 20.0)],
)  # fmt: skip
def test_rates_of_fusion_are_those_of_the_sheet(mode, rate_hz, field_hz):
    settings = {'mode': mode, 'rate_hz': rate_hz}
    made = Bno055(ScriptedRegisters(()), SimulatedClock(), settings)
    assert (made.rate_hz, made.rates_hz['magnetic_field']) == (rate_hz, field_hz)
