# SPDX-License-Identifier: Apache-2.0
"""The health check stays calm on good data and names every fault that is put in."""

from dataclasses import replace

from imu_bench.bags.problems import COUNTS, INCOMPLETE, NOT_A_NUMBER, Problem
from imu_bench.offline import health
from imu_bench.offline.health import Health
from imu_bench.samples import Samples
import numpy as np
import pytest
from scipy import signal

BAD = ('warning', 'severe')


def codes(found, severities=BAD):
    return {finding.code for finding in found.findings if finding.severity in severities}


def finding(found, code):
    [match] = [f for f in found.findings if f.code == code]
    return match


def changed(samples, field, function):
    """Return samples with one of their columns changed by a function."""
    column = np.array(getattr(samples, field))
    return replace(samples, **{field: function(column)})


def without(samples, keep):
    return Samples(
        samples.stamps[keep], samples.acceleration[keep], samples.angular_velocity[keep]
    )


class TestCalm:
    @pytest.mark.parametrize('rate', [10.0, 100.0, 500.0])
    @pytest.mark.parametrize('seed', [1, 2])
    def test_says_nothing_on_white_noise(self, recording_of, noise, rate, seed):
        assert health.check(recording_of(noise(seed, rate=rate))).findings == ()

    def test_says_nothing_on_a_noisy_sensor(self, recording_of, noise):
        samples = noise(acceleration=0.3, angular_velocity=0.2)
        assert health.check(recording_of(samples)).findings == ()

    def test_says_nothing_on_bias_instability_and_walk(self, recording_of, noise):
        samples = noise(3)
        rng = np.random.default_rng(4)
        walk = np.cumsum(rng.normal(0.0, 1e-4 / 10.0, (len(samples), 3)), axis=0)
        samples = changed(samples, 'acceleration', lambda a: a + walk)
        samples = changed(samples, 'angular_velocity', lambda g: g + 0.1 * walk)
        assert health.check(recording_of(samples)).findings == ()

    def test_says_nothing_on_quantised_noise(self, recording_of, noise):
        samples = changed(noise(5), 'acceleration', lambda a: np.round(a / 0.01) * 0.01)
        found = health.check(recording_of(samples))
        assert found.findings == ()
        assert found.resolution['linear_acceleration.x'].value == pytest.approx(0.01, rel=1e-6)

    def test_says_nothing_on_filtered_noise(self, recording_of, noise):
        kernel = np.ones(20) / 20.0
        samples = noise(6, n=120_000, rate=1000.0)

        def smooth(column):
            return np.apply_along_axis(lambda c: np.convolve(c, kernel, 'valid'), 0, column)

        part = Samples(
            samples.stamps[19:], smooth(samples.acceleration), smooth(samples.angular_velocity)
        )
        assert health.check(recording_of(part)).findings == ()

    def test_says_nothing_on_usual_jitter(self, recording_of, noise):
        assert health.check(recording_of(noise(jitter_s=3e-4))).findings == ()

    def test_an_axis_of_nan_is_an_axis_the_sensor_lacks(self, recording_of, noise):
        def blank(column):
            column[:, 1] = np.nan
            return column

        found = health.check(recording_of(changed(noise(), 'acceleration', blank)))
        assert found.findings == ()
        assert 'linear_acceleration.y' not in found.resolution


class TestClock:
    def test_gaps(self, recording_of, noise):
        samples = noise()
        keep = np.ones(len(samples), dtype=bool)
        keep[30_000:31_000] = False
        keep[40_000:40_010] = False
        found = health.check(recording_of(without(samples, keep)))
        assert codes(found) == {'gaps'}
        text = finding(found, 'gaps').text
        assert text.startswith('2 gaps')
        assert '1.7 %' in text
        assert '5 min' in text
        assert found.missing == 1010
        assert [gap.missing for gap in found.gaps] == [1000, 10]

    def test_scattered_losses_name_the_option(self, recording_of, noise):
        samples = noise()
        keep = np.random.default_rng(1).random(len(samples)) > 0.002
        keep[0] = True
        found = finding(health.check(recording_of(without(samples, keep))), 'gaps')
        assert found.severity == 'warning'
        assert 'longest are lost' in found.effect
        assert '--min-share 0.95' in found.action
        keep[:] = True
        keep[5000:5400] = False
        few = finding(health.check(recording_of(without(samples, keep))), 'gaps')
        assert '--min-share' not in few.action

    def test_many_gaps_are_severe(self, recording_of, noise):
        samples = noise()
        keep = np.random.default_rng(1).random(len(samples)) > 0.2
        keep[0] = True
        assert finding(health.check(recording_of(without(samples, keep))), 'gaps').severity == (
            'severe'
        )

    def test_duplicates(self, recording_of, noise):
        samples = noise()
        twice = np.sort(np.concatenate([np.arange(len(samples)), np.arange(100, 20_100, 100)]))
        found = health.check(recording_of(without(samples, twice)))
        assert 'duplicates' in codes(found)
        assert found.duplicates == 200

    def test_order_faults(self, recording_of, noise):
        samples = noise()
        stamps = np.array(samples.stamps)
        stamps[5000] -= 3_000_000_000
        found = health.check(recording_of(replace(samples, stamps=stamps)))
        assert 'order' in codes(found)
        assert found.order_faults == 1

    @pytest.mark.parametrize(('jitter', 'severity'), [(2e-3, 'warning'), (8e-3, 'severe')])
    def test_jitter(self, recording_of, noise, jitter, severity):
        found = health.check(recording_of(noise(jitter_s=jitter / np.sqrt(2.0))))
        assert finding(found, 'jitter').severity == severity

    def test_short(self, recording_of, noise):
        assert codes(health.check(recording_of(noise(n=1000))), ('info',)) == {'short'}

    def test_receive_time_used(self, recording_of, noise):
        found = health.check(
            recording_of(
                noise(), stamp_source='receive', stamp_reason='every header stamp is zero'
            )
        )
        assert 'every header stamp is zero' in finding(found, 'stamps').text

    def test_clocks_apart_and_drifting(self, recording_of, noise):
        samples = noise()
        behind = samples.stamps + 5_000_000_000
        found = health.check(recording_of(samples, receive_ns=behind))
        assert codes(found, ('info',)) == {'clock_offset'}
        drifting = behind + ((samples.stamps - samples.stamps[0]) // 2000)
        found = health.check(recording_of(samples, receive_ns=drifting))
        assert codes(found, ('info',)) == {'clock_offset', 'clock_drift'}
        assert '500 ppm' in finding(found, 'clock_drift').text


class TestReading:
    def test_incomplete_bag(self, recording_of, noise):
        found = health.check(recording_of(noise()), problems=[Problem('no footer', INCOMPLETE)])
        assert finding(found, 'incomplete').text == 'no footer.'
        assert finding(found, 'incomplete').severity == 'warning'

    def test_words_alone_are_a_remark_whatever_they_say(self, recording_of, noise):
        words = 'a.csv: column "cut off" is not used'
        found = health.check(recording_of(noise()), problems=[words])
        assert finding(found, 'reading').severity == 'info'

    def test_counts_of_this_topic_are_told_once(self, recording_of, noise):
        recording = recording_of(noise(), announced=60_010)
        own, other = (
            Problem('metadata.yaml announces', COUNTS, topic) for topic in (recording.topic, '/tf')
        )
        found = health.check(recording, problems=[own, other])
        assert [f.code for f in found.findings] == ['counts', 'reading']

    def test_counts_disagree(self, recording_of, noise):
        assert codes(health.check(recording_of(noise(), announced=60_010))) == {'counts'}
        found = health.check(recording_of(noise(), announced=90_000))
        assert finding(found, 'counts').severity == 'severe'

    def test_values_left_out(self, recording_of, noise):
        words = 'linear_acceleration.x: 3 NaN and 1 infinite values left out'
        note = Problem(words, NOT_A_NUMBER)
        found = health.check(
            recording_of(noise(), stored=60_004, announced=60_004, left_out=4, notes=(note,))
        )
        assert note in finding(found, 'not_a_number').text


class TestValues:
    def test_constant(self, recording_of, noise):
        def stop(column):
            column[:, 2] = 9.81
            return column

        found = health.check(recording_of(changed(noise(), 'acceleration', stop)))
        assert codes(found) == {'constant'}
        assert 'linear_acceleration.z is constant' in finding(found, 'constant').text

    def test_stuck_for_a_while(self, recording_of, noise):
        def freeze(column):
            column[20_000:20_200] = column[20_000]
            return column

        samples = changed(noise(), 'acceleration', freeze)
        samples = changed(samples, 'angular_velocity', freeze)
        found = health.check(recording_of(samples))
        assert codes(found) == {'stuck'}
        text = finding(found, 'stuck').text
        assert '200 samples at t = 3 min 20 s' in text

    def test_read_twice(self, recording_of, noise):
        samples = noise()
        source = np.arange(len(samples)) // 2
        doubled = Samples(
            samples.stamps, samples.acceleration[source], samples.angular_velocity[source]
        )
        found = health.check(recording_of(doubled))
        assert finding(found, 'repeated').severity == 'severe'
        assert '50 %' in finding(found, 'repeated').text
        assert 'outliers' not in codes(found) and 'resolution' not in codes(found)

    def test_saturated(self, recording_of, noise):
        samples = changed(noise(), 'angular_velocity', lambda g: np.clip(g, -0.002, 0.002))
        found = health.check(recording_of(samples))
        assert 'saturated' in codes(found)
        assert 'angular_velocity.x at -0.002' in finding(found, 'saturated').text

    def test_the_tail_of_a_coarse_signal_is_not_cut_off(self, recording_of, noise):
        """The last value but one may be missing by chance."""

        def tail(column):
            order = np.argsort(column[:, 1])
            steps = np.repeat([0, 1, 2, 3], [5, 1, 12, 17])
            column[order[: steps.size], 1] = column[order[steps.size], 1] + 5e-3 * (steps - 4)
            return column

        samples = changed(noise(), 'acceleration', lambda a: np.round(a / 5e-3) * 5e-3)
        found = health.check(recording_of(changed(samples, 'acceleration', tail)))
        assert 'saturated' not in codes(found)

    def test_coarse(self, recording_of, noise):
        samples = changed(noise(), 'acceleration', lambda a: np.round(a / 0.1) * 0.1)
        assert 'resolution' in codes(health.check(recording_of(samples)))

    @pytest.mark.parametrize(('steps', 'told'), [(1.8, False), (0.8, False), (0.4, True)])
    def test_noise_behind_a_low_pass_is_not_judged_by_its_neighbours(
        self, recording_of, noise, steps, told
    ):
        """As the SCL3300 is read: neighbours are alike, and yet the noise is above a step."""

        def filtered(acceleration):
            slow = signal.lfilter([1.0], [1.0, -0.9], acceleration - acceleration.mean(), axis=0)
            slow *= steps * 1e-3 / slow[1000:].std(axis=0)
            return np.round((9.8 * np.array([0.0, 0.0, 1.0]) + slow) / 1e-3) * 1e-3

        found = health.check(recording_of(changed(noise(), 'acceleration', filtered)))
        assert ('resolution' in codes(found)) is told

    def test_what_sticks_out_of_rounded_noise_by_seven_sigma_is_no_outlier(
        self, recording_of, noise
    ):
        """The median of steps of one or two digits is up to half a digit too small."""

        def rounded(column):
            column[12_345] = 0.5 * (column[12_344] + column[12_346]) + 7.0 * 0.02
            return np.round(column / 0.0132) * 0.0132

        found = health.check(recording_of(changed(noise(), 'acceleration', rounded)))
        assert 'outliers' not in codes(found)

    def test_outliers(self, recording_of, noise):
        def spoil(column):
            column[12_345, 0] += 1.0
            column[30_000, 0] -= 2.0
            return column

        found = health.check(recording_of(changed(noise(), 'acceleration', spoil)))
        assert codes(found) == {'outliers'}
        assert finding(found, 'outliers').text.startswith('2 outliers')

    def test_acceleration_in_g(self, recording_of, noise):
        samples = changed(noise(), 'acceleration', lambda a: a / 9.80665)
        assert 'look like g' in finding(health.check(recording_of(samples)), 'gravity').text

    @pytest.mark.parametrize(
        ('factor', 'severity'),
        [(15_000.0, 'severe'), (1.25, 'severe'), (0.75, 'severe'), (1.17, 'warning'),
         (0.83, 'warning'), (1.1, 'info')],
    )  # fmt: skip
    def test_a_wrong_scale_at_rest(self, recording_of, noise, factor, severity):
        samples = changed(noise(), 'acceleration', lambda a: a * factor)
        found = health.check(recording_of(samples)).findings
        assert [f.severity for f in found if f.code.startswith('gravity')] == [severity]

    def test_a_ride_differs_from_gravity_and_counts_do_all_the_same(self, recording_of, noise):
        def ride(a):
            return 1.4 * a + 8.0 * np.sin(np.arange(len(a)) / 200.0)[:, None]

        rode = health.check(recording_of(changed(noise(), 'acceleration', ride)))
        assert finding(rode, 'motion').severity == 'severe'
        assert finding(rode, 'gravity').severity == 'warning'
        counts = changed(noise(), 'acceleration', lambda a: 2048.0 * ride(a))
        assert finding(health.check(recording_of(counts)), 'gravity').severity == 'severe'

    def test_gravity_removed_is_only_mentioned(self, recording_of, noise):
        samples = changed(noise(), 'acceleration', lambda a: a - [0, 0, 9.80665])
        found = health.check(recording_of(samples))
        assert codes(found) == set()
        assert finding(found, 'gravity').severity == 'info'


class TestMotion:
    def test_a_turn_in_a_still_test(self, recording_of, noise):
        def turn(column):
            column[30_000:30_400, 2] += 0.3
            return column

        found = health.check(recording_of(changed(noise(), 'angular_velocity', turn)))
        assert codes(found) == {'motion'}
        [(begin, end)] = found.motion
        assert 298.0 <= begin <= 300.0
        assert 304.0 <= end <= 306.0
        assert found.still == (0.0, begin)
        assert finding(found, 'motion').severity == 'warning'

    def test_a_knock(self, recording_of, noise):
        def knock(column):
            column[10_000:10_040] += np.random.default_rng(1).normal(0.0, 3.0, (40, 3))
            return column

        found = health.check(recording_of(changed(noise(), 'acceleration', knock)))
        assert 'motion' in codes(found)
        assert 'outliers' not in codes(found)

    def test_the_first_moment_of_a_motion_is_no_outlier(self, recording_of, noise):
        """It may fall into the end of a block that is otherwise still."""

        def turn(column):
            column[29_997:30_400] += np.random.default_rng(2).normal(0.0, 0.3, (403, 3))
            return column

        found = health.check(recording_of(changed(noise(), 'angular_velocity', turn)))
        assert 'motion' in codes(found) and 'outliers' not in codes(found)

    def test_moving_all_the_time(self, recording_of, noise):
        time = np.arange(60_000) / 100.0
        sway = 0.3 * np.sin(2 * np.pi * 0.1 * time)[:, None]
        found = health.check(
            recording_of(changed(noise(), 'angular_velocity', lambda g: g + sway))
        )
        assert finding(found, 'motion').severity == 'severe'


def test_json_round_trip(recording_of, noise):
    samples = noise()
    keep = np.ones(len(samples), dtype=bool)
    keep[100:200] = False
    found = health.check(recording_of(without(samples, keep), announced=7))
    document = found.to_json()
    assert Health.from_json(document).to_json() == document
    assert document['severity'] == 'severe'


def test_temperature_drift_is_mentioned(recording_of, noise):
    samples = noise()
    warm = replace(samples, temperature=np.linspace(25.0, 35.0, len(samples)))
    assert codes(health.check(recording_of(warm)), ('info',)) == {'temperature'}
