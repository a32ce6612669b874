# SPDX-License-Identifier: Apache-2.0
"""Which topics of a graph are recorded without a bench, and what is said when there are none."""

import pytest

pytestmark = pytest.mark.ros

IMU, FIELD = 'sensor_msgs/msg/Imu', 'sensor_msgs/msg/MagneticField'
GRAPH = {
    '/bench/a/imu/data_raw': IMU,
    '/bench/a/inclination': 'geometry_msgs/msg/Vector3Stamped',
    '/camera/field': FIELD,
    '/camera/imu': IMU,
    '/chatter': 'std_msgs/msg/String',
    '/diagnostics': 'diagnostic_msgs/msg/DiagnosticArray',
}


@pytest.fixture
def find(monkeypatch):
    """Return the function that waits for topics, on a clock that runs while it sleeps."""
    from imu_bench.recording import session

    clock = [0.0]
    monkeypatch.setattr('time.monotonic', lambda: clock[0])
    monkeypatch.setattr('time.sleep', lambda s: clock.__setitem__(0, clock[0] + s))

    def wait(graphs, wanted=(), ask=lambda: None):
        graph = graphs if callable(graphs) else lambda: graphs
        return session.await_topics(graph, wanted, ask), clock[0]

    return wait


def test_every_imu_topic_with_its_neighbours(find):
    topics, _ = find(GRAPH)
    assert topics.main == ('/bench/a/imu/data_raw', '/camera/imu')
    assert set(topics.recorded) == set(GRAPH) - {'/chatter'}
    assert len(topics.recorded) == len(GRAPH) - 1


def test_topics_that_are_found_one_after_the_other(find):
    looks = iter([{}, {'/camera/imu': IMU}, *[GRAPH] * 100])
    topics, took_s = find(lambda: next(looks))
    assert topics.main == ('/bench/a/imu/data_raw', '/camera/imu')
    assert took_s < 3.0


def test_only_what_is_named(find):
    topics, took_s = find(GRAPH, ['chatter', '/camera/imu', '/chatter'])
    assert topics.main == topics.recorded == ('/chatter', '/camera/imu')
    assert took_s == 0.0


def test_the_name_of_a_sensor_stands_for_its_only_imu_topic(find):
    """Once no topic has come for a while: another of the same name may be on its way."""
    topics, took_s = find(GRAPH, ['a', '/camera/imu'])
    assert topics.main == topics.recorded == ('/bench/a/imu/data_raw', '/camera/imu')
    assert took_s >= 1.5


@pytest.mark.parametrize(
    ('graph', 'wanted', 'text'),
    [
        (
            {'/chatter': 'x'},
            (),
            'nobody publishes an Imu topic after 10 s; start a driver, check ',
        ),
        (GRAPH, ('/nope', '/camera/imu'), '/nope: nobody publishes this after 10 s; Imu topics: '),
        (
            GRAPH,
            ('imu',),
            "'imu' names several topics: /bench/a/imu/data_raw, /camera/imu",
        ),
    ],
)
def test_nobody_publishes_it(find, graph, wanted, text):
    from imu_bench.errors import NotReady

    with pytest.raises(NotReady) as caught:
        find(graph, wanted)
    assert str(caught.value).startswith(text)


def test_a_bench_that_runs_already_is_not_started_a_second_time():
    from imu_bench.errors import NotReady
    from imu_bench.recording.session import refuse_two_of_one

    def who(topic):
        return f'/driver of {topic}'

    refuse_two_of_one(GRAPH, ['/bench/b/imu/data_raw'], who)
    words = '/bench/a/imu/data_raw: /driver of /bench/a/imu/data_raw publishes this already'
    with pytest.raises(NotReady, match=words):
        refuse_two_of_one(GRAPH, ['/bench/b/imu/data_raw', '/bench/a/imu/data_raw'], who)


def test_who_waits_can_be_interrupted(find):
    def ask():
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        find({}, ask=ask)
