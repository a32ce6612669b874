# SPDX-License-Identifier: Apache-2.0
"""The one verdict of demo and record, on bags that lack what was published."""

from collections import Counter
from types import SimpleNamespace

from imu_bench.bags.topic_info import describe
from imu_bench.bags.writer import BagWriter
from imu_bench.cli.record import conclude
import pytest

pytestmark = pytest.mark.ros

TOPIC = '/bench/tilt/imu/data_raw'
ALLAN = '/bench/tilt/imu/allan_deviation'


@pytest.fixture
def judge(sensor, recorder, now, tmp_path):
    """Return a function that judges a bag with so many of the 1000 messages there were."""
    from imu_bench.recording.judgement import Judgement

    def judged(stored, *, failure='', restarts=(), recorder_ended=False, killed=()):
        with BagWriter(tmp_path / 'bag') as bag:
            bag.add_topic(describe(TOPIC, 'sensor_msgs/msg/Imu'))
            for number in range(stored):
                bag.write(TOPIC, number, b'...')
        now.s += 4.0
        sensor.say(1000)
        showing = SimpleNamespace(
            rows=(sensor.row,), failure=failure, restarts=Counter(restarts), ran_s=4.0,
            recorder_ended=recorder_ended,
        )  # fmt: skip
        return Judgement(
            tmp_path / 'bag', {'tilt': sensor.view}, recorder, showing, now.s, '', killed
        )

    return judged


def said(judgement, capsys):
    """Return the exit code, what was printed, and the complaints."""
    code = conclude(judgement, 4.0, 'imu-bench analyze')
    return (code, *(text.replace('\u202f', '') for text in capsys.readouterr()))


def test_all_is_well_when_everything_is_in_the_bag(judge, capsys):
    code, output, complaints = said(judge(1000), capsys)
    assert (code, complaints) == (0, '')
    assert 'tilt: 1000 messages, kept its rate (200.0 of 200 Hz), nothing lost\n' in output
    assert 'lost on the way' not in output


@pytest.mark.parametrize('missing', [1, 500])
def test_what_the_recorder_missed_is_never_nothing(judge, capsys, missing):
    code, output, complaints = said(judge(1000 - missing), capsys)
    assert code == 1
    assert 'nothing lost' not in output
    assert f'{missing} lost on the way to the recorder\n' in output
    assert 'lost on the way to the recorder: the recorder was stopped' in output  # what to do
    assert f'tilt lost {missing} on the way to the recorder' in complaints


def test_a_topic_that_nobody_looks_at_counts_too(judge, recorder, capsys):
    recorder.values |= {f'missed.{ALLAN}': '2', f'stored.{ALLAN}': '7'}
    code, output, complaints = said(judge(1000), capsys)
    assert code == 1
    assert f'{ALLAN}: 2 lost on the way to the recorder' in output
    assert f'{ALLAN}: lost 2 on the way to the recorder' in complaints


def test_a_process_that_had_to_be_started_again_is_a_fault(judge, capsys):
    code, _, complaints = said(judge(1000, restarts={'sensors': 2}), capsys)
    assert code == 1
    assert 'sensors ended by itself and was started again 2 times' in complaints


def test_what_came_after_the_recorder_had_ended_is_not_its_loss(judge, capsys):
    judgement = judge(800, failure='the disk is full', recorder_ended=True)
    code, output, complaints = said(judgement, capsys)
    assert code == 1
    assert 'on the way' not in output
    assert complaints.endswith('bag: the disk is full\n')


def test_what_a_killed_process_held_is_a_fault(judge, capsys):
    code, _, complaints = said(judge(1000, killed=['sensors']), capsys)
    assert code == 1
    assert 'sensors did not stop and was killed: what it held is not in the bag' in complaints


def test_a_second_recorder_of_ours_is_a_fault_another_programs_is_none(judge, recorder, capsys):
    recorder.values['recorders'] = '/recorder, /rosbag2_recorder'
    judgement = judge(1000)
    code, _, complaints = said(judgement, capsys)
    assert (code, complaints) == (0, '')
    recorder.values |= {'recorders': '/recorder, /recorder', 'second_bag': '/home/ann/night'}
    code, _, complaints = said(judgement, capsys)
    assert code == 1
    assert 'several record this: /recorder, /recorder, another into /home/ann/night' in complaints


def test_what_others_say_steers_no_terminal(judge, recorder, capsys):
    evil = '\x1b]0;owned\x07'
    recorder.values |= {f'beside./{evil}': '0', f'missed./{evil}': '2', f'several./{evil}': evil}
    _, output, complaints = said(judge(1000), capsys)
    assert output.count('\\x1b]0;owned') == 2
    assert complaints.count('\\x1b]0;owned') >= 2
    assert '\x1b' not in output + complaints
    assert '\x07' not in output + complaints


def test_a_flood_is_one_line_and_no_fault(judge, recorder, capsys):
    recorder.values['left_out./diagnostics'] = '1200'
    code, output, complaints = said(judge(1000), capsys)
    assert (code, complaints) == (0, '')
    assert output.count('/diagnostics: flooded, 1200 messages left out of the bag\n') == 1
