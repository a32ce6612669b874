# SPDX-License-Identifier: Apache-2.0
"""
A recording to which something happens, as `./run benchmark survive` does it, made short.

What the bag lacks is found by rosbags and the sensors' own stamps.
"""

from functools import partial

import pytest

from benchmarks import _survive_rows as rows
from benchmarks._measured import proportional_set
from benchmarks._recorded import generic_bench, READING, RECORDER, Recording, SENSORS
from benchmarks._survive_stage import RATES, Stage

pytestmark = [pytest.mark.ros, pytest.mark.slow]


@pytest.fixture
def stage(tmp_path):
    return Stage(tmp_path, seconds=4.0, quick=True, kills=1, suspended_s=2.0, seed=25)


@pytest.mark.parametrize(
    'row',
    [
        partial(rows.stopped, seconds=3.0),
        partial(rows.beside, bench='sources', loops=4),
        rows.clock_jumps,
    ],
    ids=['recorder stopped for 3 s', 'four busy programs', 'clock an hour on, two back'],
)
def test_nothing_is_lost(stage, row):
    outcome = row(stage)
    assert outcome.problems == []
    assert outcome.samples > 4.0 * sum(RATES[:2])
    assert (outcome.missing, outcome.on_the_way, outcome.unsaid) == (0, 0, 0)
    assert outcome.code == 0


@pytest.mark.parametrize('victim', [rows.RECORDER, rows.SENSORS, rows.READING])
def test_what_is_killed_leaves_a_bag_that_is_read(stage, victim):
    outcome = rows.kill(stage, victim, 2.0)
    # how much is lost before the kill depends on what else the machine does
    assert [each for each in outcome.problems if 'before the kill' not in each] == []
    assert outcome.samples > 0
    assert outcome.on_the_way == 0
    assert outcome.code == 1


def test_six_sensors_fit_into_memory(tmp_path, stage):
    """
    Sensors, what reads them and the recorder, without the analysis, which has 110 MB.

    A bound that notices when somebody imports more; the goal is 350 MB with the analysis.
    """
    with Recording(tmp_path, str(generic_bench(tmp_path, RATES)), 2.0) as recording:
        recording.wait_begun()
        recording.pass_time(1.0)
        held = {
            role: sum(map(proportional_set, recording.processes(role)))
            for role in (SENSORS, READING, RECORDER)
        }
        recording.wait_ended()
    assert all(held.values())
    assert sum(held.values()) < 250e6, held
