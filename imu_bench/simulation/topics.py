# SPDX-License-Identifier: Apache-2.0
"""The messages that a sensor's node would publish, as rows of bytes for a bag."""

from __future__ import annotations

from collections.abc import Iterator

from imu_bench.bags.sensor_messages import (
    IMU,
    INCLINATION,
    MAGNETIC_FIELD,
    Messages,
    TEMPERATURE,
    TYPES,
)
from imu_bench.bags.topic_info import describe, OfferedQos, TopicInfo
from imu_bench.metrology.trials.inclination import inclination
from imu_bench.samples import AXES, Samples
from imu_bench.simulation.simulated import SimulatedSensor
from msg_conversions import cdr, covariance
from msg_conversions.templates import ImuTemplate, Template
import numpy as np
import numpy.typing as npt

TEMPERATURE_HZ = 10.0
"""A node publishes the newest temperature of each block it reads; here that often at most."""

TRANSPORT_NS = 1_000_000
"""From the measurement to the recorder: about what the live bench has, always the same."""


class SensorMessages:
    """
    Turns samples of one sensor into messages.

    Parameters
    ----------
    sensor : SimulatedSensor
    """

    def __init__(self, sensor: SimulatedSensor) -> None:
        config = sensor.config
        self._namespace = config.namespace
        self._quantities = {q for source in sensor.sources for q in source.quantities}
        # one temperature out of so many samples
        self._every = max(1, round(sensor.rate_hz / TEMPERATURE_HZ))
        self._before_temperature = 0
        stddevs = {f'{name}': float(value) for name, value in config.stddevs.items()}
        self._imu = ImuTemplate(
            config.frame_id,
            acceleration_covariance=self._covariance(
                'acceleration', 'linear_acceleration', stddevs
            ),
            angular_velocity_covariance=self._covariance(
                'angular_velocity', 'angular_velocity', stddevs
            ),
        )
        field = covariance.diagonal(stddevs.get('magnetic_field', 0.0))
        self._magnetic_field = Template(config.frame_id, (0.0, 0.0, 0.0, *field))
        self._temperature = Template(config.frame_id, (0.0, 0.0))
        self._angle_step = sensor.angle_step
        self._inclination = Template(config.frame_id, (0.0, 0.0, 0.0))

    @property
    def topics(self) -> list[TopicInfo]:
        """What the bag is to know of the topics."""
        names = [IMU] if self._quantities & {'acceleration', 'angular_velocity'} else []
        names += [MAGNETIC_FIELD] if 'magnetic_field' in self._quantities else []
        names += [TEMPERATURE] if 'temperature' in self._quantities else []
        names += [INCLINATION] if self._angle_step else []
        return [
            describe(f'{self._namespace}/{name}', TYPES[name], [OfferedQos()]) for name in names
        ]

    def encode(self, run: Samples) -> Iterator[Messages]:
        """Yield the messages of one run."""
        if not len(run):
            return
        if run.acceleration is not None or run.angular_velocity is not None:
            rows = self._imu.imu_rows(run.stamps, run.acceleration, run.angular_velocity)
            yield self._messages(IMU, run.stamps, rows)
        if run.magnetic_field is not None:
            part = (cdr.MAGNETIC_FIELD_VECTOR, run.magnetic_field)
            rows = self._magnetic_field.rows(run.stamps, part)
            yield self._messages(MAGNETIC_FIELD, run.stamps, rows)
        if run.temperature is not None:
            chosen = slice(self._before_temperature, None, self._every)
            stamps = run.stamps[chosen]
            taken = (cdr.TEMPERATURE_VALUE, run.temperature[chosen, None])
            self._before_temperature += stamps.size * self._every - len(run)
            if stamps.size:
                rows = self._temperature.rows(stamps, taken)
                yield self._messages(TEMPERATURE, stamps, rows)

        if run.acceleration is not None and self._angle_step:
            angles = [inclination(run.acceleration, axis) for axis in AXES]
            steps = np.rint(np.column_stack(angles) / self._angle_step)
            part = (cdr.VECTOR3_VECTOR, steps * self._angle_step)
            yield self._messages(INCLINATION, run.stamps, self._inclination.rows(run.stamps, part))

    def _messages(
        self, name: str, stamps: npt.NDArray[np.int64], rows: npt.NDArray[np.uint8]
    ) -> Messages:
        return Messages(f'{self._namespace}/{name}', stamps + TRANSPORT_NS, rows)

    def _covariance(
        self, quantity: str, name: str, stddevs: dict[str, float]
    ) -> tuple[float, ...]:
        if quantity not in self._quantities:
            return covariance.NOT_REPORTED
        return covariance.diagonal(stddevs.get(name, 0.0))
