# SPDX-License-Identifier: Apache-2.0
"""A sensor as its node speaks of it, on a clock that stands still."""

from types import SimpleNamespace

import pytest

SPACE = '/bench/tilt'
TOPIC = f'{SPACE}/imu/data_raw'
PUBLISHED = 'published.imu/data_raw'


@pytest.fixture
def now(monkeypatch):
    """Return the monotonic clock, which stands still until a test sets it."""
    clock = SimpleNamespace(s=1000.0)
    monkeypatch.setattr('time.monotonic', lambda: clock.s)
    return clock


@pytest.fixture
def recorder():
    from imu_bench.live.views import RecorderView

    return RecorderView('/bag', values={f'stored.{TOPIC}': '200'}, heard_s=1000.0)


class Sensor:
    """A sensor of 200 Hz as its node would speak of it."""

    def __init__(self, recorder, clock, **values):
        from imu_bench.live.views import SensorView
        from imu_bench.recording.rows import SensorRow

        self.clock, self.view = clock, SensorView('tilt', level=0)
        self.row = SensorRow(self.view, recorder, SPACE)
        self.say(200, **values)
        self.row.begin()

    def say(self, samples, lost=0, level=0, message='', **values):
        """Say at this moment how many samples there were."""
        own = {'nominal_hz': '200', 'delivered_hz': '200.0', 'rate_hz': '200.02'}
        counts = {'samples': samples, 'lost': lost, 'dropped': 0, PUBLISHED: samples}
        said = {name: str(value) for name, value in {**own, **counts, **values}.items()}
        self.view.hear(level, message, said)

    def verdict(self, stored, ended_s=None):
        """Judge a bag with so many messages; None is one that was not finished."""
        bag = None if stored is None else {TOPIC: stored}
        return self.row.verdict(bag, self.row.account(bag), ended_s or self.clock.s)


@pytest.fixture
def played(sensor):
    """Return the sensor as one that plays a recording."""
    sensor.row.plays = True
    return sensor


@pytest.fixture
def make_sensor(recorder, now):
    """Return a function that makes a sensor which has said something."""
    return lambda **values: Sensor(recorder, now, **values)


@pytest.fixture
def sensor(make_sensor):
    return make_sensor()
