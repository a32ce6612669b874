# SPDX-License-Identifier: Apache-2.0
"""What is missed, counted from numbers, against what was really lost."""

from random import Random

from hypothesis import given, settings
from hypothesis import strategies as st
from imu_bench.nodes.sequences import Sequences


def found(topic):
    return topic.received, topic.missed, topic.before, topic.publishers


@given(st.integers(0, 1000), st.lists(st.booleans(), min_size=1, max_size=200), st.integers(1, 20))
def test_of_one_publisher_every_gap_is_counted(start, arrived, batch):
    numbers = [start + index for index, kept in enumerate(arrived) if kept]
    topic = Sequences()
    for at in range(0, len(numbers), batch):
        topic.take(numbers[at : at + batch])
    if not numbers:
        assert found(topic) == (0, 0, 0, 0)
        return
    span = numbers[-1] - numbers[0] + 1
    assert found(topic) == (len(numbers), span - len(numbers), numbers[0], 1)


@given(st.integers(2, 5), st.integers(0, 10**9), st.integers(1, 7))
@settings(max_examples=50)
def test_several_publishers_without_loss_miss_nothing(publishers, seed, batch):
    random = Random(seed)
    due = [0] * publishers
    numbers = []
    for _ in range(200):
        which = random.randrange(publishers)
        numbers.append(due[which])
        due[which] += 1
    topic = Sequences(lambda: publishers)
    for at in range(0, len(numbers), batch):
        topic.take(numbers[at : at + batch])
    assert topic.known
    assert found(topic) == (200, 0, 0, sum(number > 0 for number in due))


def test_a_gap_that_may_be_a_publisher_not_heard_before_is_not_known():
    topic = Sequences(lambda: 2)
    topic.take([0, 1, 2])
    topic.take([300, 301])
    assert not topic.known
    assert topic.entries('/imu') == {'missed./imu': 'not known'}
    assert topic.received == 5


@given(st.integers(0, 10**9))
@settings(max_examples=50)
def test_losses_of_several_publishers_are_counted_nearly_or_not_known(seed):
    random = Random(seed)
    due = [0, 0, 0]
    sent = []
    for _ in range(300):
        which = random.randrange(3)
        sent.append((which, due[which]))
        due[which] += 1
    # without the last of each nothing is known of what was lost before it
    last = set(dict(sent).items())
    kept = [each for each in sent if each[1] == 0 or each in last or random.random() > 0.1]
    topic = Sequences(lambda: 3)
    topic.take([number for _, number in kept])
    lost = len(sent) - len(kept)
    assert not topic.known or abs(topic.missed - lost) <= 3 + 0.1 * lost


def test_a_restart_is_a_publisher_and_no_loss():
    around = 1
    topic = Sequences(lambda: around)
    topic.take(list(range(100)))
    around = 2
    topic.take(list(range(50)))
    assert found(topic) == (150, 0, 0, 2)


def test_blocks_are_counted_by_publisher():
    topic = Sequences()
    topic.take_run(77, 10, 5)
    topic.take_run(88, 0, 5)
    topic.take_run(77, 15, 5)
    topic.take_run(77, 23, 2)
    assert found(topic) == (17, 3, 10, 2)


def test_without_numbers_nothing_is_known():
    topic = Sequences()
    topic.take([None, None])
    assert not topic.known
    assert topic.received == 2
