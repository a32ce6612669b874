# SPDX-License-Identifier: Apache-2.0
"""What a demo makes of nodes that end, without any process."""

from types import SimpleNamespace

from imu_bench.cli.demo import kinds
from imu_bench.cli.live import BenchShowing
from imu_bench.config import BenchConfig, SensorConfig
from imu_bench.errors import NotReady
import pytest

pytestmark = pytest.mark.ros


@pytest.fixture
def showing():
    """Return a demo of a sensor that is played and one that is not; `codes` lets them end."""
    codes = {}
    processes = SimpleNamespace(
        ended=lambda: codes,
        last_words=lambda name: f'{name}: over after 12.9 s',
        log=lambda name: 'x.log',
    )
    views = {'then': SimpleNamespace(publishing=True), 'now': SimpleNamespace(publishing=True)}
    monitor = SimpleNamespace(sensors=views)
    made = BenchShowing(monitor, processes, 60.0, played={'then'})
    made.codes = codes
    return made


def test_a_recording_that_is_over_is_told_once_and_the_others_go_on(showing):
    assert not list(showing.look())
    showing.codes['then'] = 0
    assert list(showing.look()) == ['then: over after 12.9 s']
    assert not list(showing.look())
    assert not showing.over(13.0)
    assert showing.over(60.0)


def test_when_all_that_is_played_is_over_so_is_the_demo(showing):
    del showing._monitor.sensors['now']
    showing.codes['then'] = 0
    assert list(showing.look())
    assert showing.over(13.0)


@pytest.mark.parametrize(('name', 'code'), [('then', 1), ('now', 0), ('recorder', 0)])
def test_any_other_end_is_a_failure(showing, name, code):
    showing.codes[name] = code
    with pytest.raises(NotReady, match=f'{name} ended with exit code {code}'):
        list(showing.look())


@pytest.mark.parametrize(
    ('backends', 'said'),
    [
        (['emulated', 'emulated'], '2 emulated sensors'),
        (['emulated'], '1 emulated sensor'),
        (['recorded', 'emulated', 'emulated'], '3 sensors (1 recorded, 2 emulated)'),
    ],
)
def test_what_stands_behind_the_sensors_is_said(backends, said):
    sensors = tuple(SensorConfig(f's{k}', 'mpu9250', kind) for k, kind in enumerate(backends))
    assert kinds(BenchConfig(name='small', sensors=sensors)) == said
