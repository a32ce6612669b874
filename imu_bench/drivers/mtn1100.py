# SPDX-License-Identifier: Apache-2.0
"""
Monitran MTN/1100: piezoelectric accelerometer with built-in electronics, one axis, analog.

No data sheet of the maker was at hand: 100 mV/g, ±80 g and 10 kHz are those of Shabulinzenze
2020, Tampere University MSc thesis, table 4.2; give the sensitivity of the unit's certificate.
It shows no constant acceleration.  Three converters are known: MCC 172 (Measurement Computing,
electrical specification rev. 2.1, ES), ADS1115 (TI SBAS444D, TI) and MCP3208 (Microchip
DS21298E, MC).  MCC 172 feeds the sensor and filters; the others need that around them.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
import math
from typing import Any, ClassVar

from imu_bench.bus.converters import Ads1115, Ads1115Registers, Converter, Mcc172, Mcp3208
from imu_bench.bus.converters.mcc172 import CLOCK_HZ
from imu_bench.bus.interface import Clock, RegisterBus
from imu_bench.bus.wiring import Wiring
from imu_bench.drivers.driver import choice, Driver, Setting, Typical, Witness
from imu_bench.errors import BusError, ConfigError
from imu_bench.registers import Axis, Channel, Register, Value
from imu_bench.samples import Samples
from imu_bench.units import STANDARD_GRAVITY

G = STANDARD_GRAVITY
SENSITIVITY = 100.0  # mV/g, Shabulinzenze 2020 table 4.2
VOLT = G / (SENSITIVITY * 1e-3)  # m/s² per volt
REFERENCE = 3.3
ADS = Ads1115Registers
CONVERTERS: Mapping[str, type[Converter]] = {'daqhat': Mcc172, 'i2c': Ads1115, 'frame': Mcp3208}


class Mtn1100(ADS, Driver):
    """Monitran MTN/1100 through MCC 172, ADS1115 (I²C) or MCP3208 (SPI)."""

    # --- document and identity -----------------------------------------------------------
    name = 'mtn1100'
    title = 'Monitran MTN/1100'
    document = 'none; converters: esmcc172 rev. 2.1, SBAS444D, DS21298E'
    bus_kinds = ('daqhat', 'i2c', 'frame')
    wiring: ClassVar[Mapping[str, Wiring]] = {
        # TI table 4; MC section 1.0: 1 MHz at 2.7 V, 2 MHz at 5 V
        '': Wiring(i2c_addresses=(0x48, 0x49, 0x4A, 0x4B), spi_max_hz=1_000_000),
    }

    # --- register map; that of the ADS1115 is inherited ----------------------------------
    # what the library of the MCC 172 hands over: calibrated codes as floats
    SCAN = Register(0x00, access='ro', size=8, addresses=1, reset=None, part='mcc172')
    # MC figure 5-1: the twelve bits that follow the null bit
    RESULT = Register(0x00, access='ro', size=2, addresses=1, reset=None, part='mcp3208')

    # fmt: off
    # --- channels: z of the body frame, at 100 mV/g --------------------------------------
    acceleration_mcc172 = Axis(
        first=SCAN, quantity='acceleration', unit='m/s²', dtype='<f8',
        si_per_lsb=5.0 / 2**23 * VOLT, limits=(-(2**23), 2**23 - 1),
    )
    acceleration_ads1115 = Axis(
        first=ADS.CONVERSION, quantity='acceleration', unit='m/s²', dtype='>i2',
        scaled_by=ADS.ads1115_range,
        si_per_lsb={6.144: 187.5e-6 * VOLT, 4.096: 125e-6 * VOLT, 2.048: 62.5e-6 * VOLT,
                    1.024: 31.25e-6 * VOLT, 0.512: 15.625e-6 * VOLT, 0.256: 7.8125e-6 * VOLT},
    )
    # the sensor's bias is half of the reference
    acceleration_mcp3208 = Axis(
        first=RESULT, quantity='acceleration', unit='m/s²', dtype='>u2', limits=(0, 4095),
        zero=2048, si_per_lsb=REFERENCE / 4096 * VOLT,
    )

    # --- settings ------------------------------------------------------------------------
    settings = (
        Setting('converter', 'by bus', 'Converter; by bus: daqhat MCC 172, I²C ADS1115, SPI '
                'MCP3208.', ('by bus', 'mcc172', 'ads1115', 'mcp3208')),
        Setting('rate_hz', 0.0, 'Sample rate; 0 is 1003.92 (51200/51) on the MCC 172, 500 on '
                'the ADS1115, 1000 on the MCP3208.', bounds=(0.0, CLOCK_HZ), unit='Hz'),
        Setting('sensitivity', SENSITIVITY, 'From the certificate of the unit.',
                bounds=(1.0, 1000.0), unit='mV/g'),
        Setting('input', 0, 'Input of the MCC 172 (0, 1) or MCP3208 (0 to 7).', bounds=(0, 7)),
        Setting('supply', True, 'Let the MCC 172 feed the sensor (IEPE).'),
        choice('ads1115_input', ADS.ads1115_input, 'A0-A1', 'Input of the ADS1115.'),
        choice('ads1115_range', ADS.ads1115_range, 2.048, 'Full scale of the ADS1115.'),
        Setting('mcp3208_reference', REFERENCE, 'Reference of the MCP3208; half of it is the '
                'bias of the sensor.', bounds=(0.25, 5.5), unit='V'),
    )
    # fmt: on
    counter_names = ('hardware_overruns', 'buffer_overruns', 'late_conversions')

    # --- typical values ------------------------------------------------------------------
    typical: ClassVar[Mapping[str, Typical]] = {
        'acceleration': Typical(
            'Shabulinzenze 2020 table 4.2; noise and high-pass assumed: no data sheet',
            noise_density=30e-6 * G,
            bandwidth=10e3,
            high_pass=1.0,
            range=80 * G,
        ),
    }

    # --- witnesses -----------------------------------------------------------------------
    witnesses = (
        # 838861/2^23·5 V is half a volt, 5 g
        Witness(acceleration_mcc172, '000000009a992941', (math.nan, math.nan, 49.03325), 'ES'),
        Witness(acceleration_ads1115, '2000', (math.nan, math.nan, 150.6301), 'TI', 6.144),
        Witness(acceleration_ads1115, '0320', (math.nan, math.nan, 9.80665), 'TI', 4.096),
        Witness(acceleration_ads1115, '0640', (math.nan, math.nan, 9.80665), 'TI', 2.048),
        Witness(acceleration_ads1115, 'f380', (math.nan, math.nan, -9.80665), 'TI', 1.024),
        Witness(acceleration_ads1115, '1900', (math.nan, math.nan, 9.80665), 'TI', 0.512),
        Witness(acceleration_ads1115, 'ce00', (math.nan, math.nan, -9.80665), 'TI', 0.256),
        Witness(acceleration_mcp3208, '087c', (math.nan, math.nan, 9.7971), 'MC: 2172 of 4096'),
    )

    # --- the stream ----------------------------------------------------------------------
    def __init__(self, bus: Any, clock: Clock, settings: Mapping[str, object]) -> None:
        super().__init__(bus, clock, settings)
        found = _kind_of(self._wires[''])
        part = CONVERTERS[found].part
        if self.values['converter'] not in ('by bus', part):
            raise ConfigError(
                f'{self.name}.converter: {self.values["converter"]} cannot be on '
                f'{self._wires[""].name}, where a {part} would be; give another bus'
            )
        try:
            self._converter = self._make(found)
        except ConfigError as error:
            raise ConfigError(f'{self.name}.{error}') from error
        self._channel: Axis = getattr(self, f'acceleration_{part}')
        reference = float(self.values['mcp3208_reference']) / REFERENCE
        trim = SENSITIVITY / float(self.values['sensitivity'])
        self.trims['acceleration'] = trim * reference if found == 'frame' else trim

    def _make(self, kind: str) -> Converter:
        values = self.values
        wire: Any = self._wires['']
        common = wire, self.clock, self.counters, float(values['rate_hz'])
        number = int(values['input'])
        if kind == 'daqhat':
            return Mcc172(*common, channel=number, supply=bool(values['supply']))
        if kind == 'frame':
            return Mcp3208(*common, channel=number)
        return Ads1115(
            *common,
            registers=self.registers,
            input_name=values['ads1115_input'],
            range_v=values['ads1115_range'],
        )

    @classmethod
    def channels_on(cls, kind: str) -> Mapping[str, Channel]:
        """Return the channel of the converter on such a bus."""
        name = f'acceleration_{CONVERTERS[kind].part}'
        return {name: getattr(cls, name)}

    def register_buses(self, wires: Mapping[str, Any]) -> Mapping[str, RegisterBus]:
        """Return the registers of the ADS1115; the others have none."""
        return {Ads1115.part: wires['']} if _kind_of(wires['']) == 'i2c' else {}

    @property
    def settling_s(self) -> float:
        """Return how long the coupling charges when the sensor is fed."""
        return self._converter.settling_s

    @property
    def rate_hz(self) -> float:
        """Return the sample rate."""
        return self._converter.rate_hz

    @property
    def paced(self) -> bool:
        """Return whether the converter waits to be asked for each sample."""
        return self._converter.paced

    @property
    def poll_period_s(self) -> float:
        """Return how often the converter wants to be read."""
        return self._converter.poll_period_s

    def identify(self) -> str:
        """Return the sensor, which says nothing about itself, and its converter."""
        return f'{self.title}, {self._converter.identify()}'

    def assignments(self) -> dict[Any, Value]:
        """Return what the registers of the ADS1115 get."""
        return dict(self._converter.assignments) if isinstance(self._converter, Ads1115) else {}

    def configure_parts(self) -> None:
        """Configure the converter, and wait until the sensor has settled."""
        self._converter.configure()

    def start(self) -> None:
        """Start converting."""
        super().start()
        self._converter.start()

    def stop(self) -> None:
        """Stop converting."""
        self._converter.stop()

    def read(self) -> list[Samples]:
        """Return everything new."""
        if not self.configured:
            self.restart()
        reading = self._converter.read()
        if reading.lost:
            self.restart()
        if not len(reading.stamps):
            return []
        if not self._channel.within(reading.words):
            self.counters['saturated'] += int(self._channel.saturated(reading.words).sum())
        range_ = None if self._channel.scaled_by is None else self.values['ads1115_range']
        si = self._channel.decode(reading.words, range_, self.trims['acceleration'])
        return [Samples(reading.stamps, acceleration=si)]

    def close(self) -> None:
        """Release the bus; a sensor that was fed is not fed any more."""
        with suppress(BusError):  # a board that is gone feeds nothing
            self._converter.release()
        super().close()


def _kind_of(wire: Any) -> str:
    """Return which kind of bus a wire is."""
    if hasattr(wire, 'scan'):
        return 'daqhat'
    return 'frame' if hasattr(wire, 'transfer') else 'i2c'
