# SPDX-License-Identifier: Apache-2.0
"""Which sample an edge belongs to, and which edges are not used."""

from collections import Counter

from imu_bench.bus.edges import Edge, Edges
import pytest

MS = 1_000_000


class Line:
    name = 'line'

    def __init__(self):
        self.told, self.closed = [], False

    def edges(self):
        told, self.told = self.told, []
        return told

    def close(self):
        self.closed = True


@pytest.fixture
def line():
    return Line()


@pytest.fixture
def edges(line):
    return Edges(line, Counter())


@pytest.mark.parametrize(
    ('told', 'found'),
    [
        ([7 * MS, 8 * MS, 9 * MS], Edge(0, 9 * MS)),
        # one that came afterwards belongs to a sample that was not there yet
        ([9 * MS, 11 * MS], Edge(0, 9 * MS)),
        # during the reading: before or after the level was latched, nobody knows
        ([9 * MS, 10 * MS + 1], None),
        # the last one was missed
        ([8 * MS], None),
        ([], None),
    ],
)
def test_the_newest_sample(line, edges, told, found):
    line.told = told
    assert edges.newest(9 * MS + MS // 2, 10 * MS + 2, MS) == found


def test_an_edge_that_came_after_one_reading_is_there_for_the_next(line, edges):
    line.told = [9 * MS, 11 * MS]
    edges.newest(10 * MS, 10 * MS + 1, 2 * MS)
    assert edges.newest(12 * MS, 12 * MS + 1, 2 * MS) == Edge(0, 11 * MS)


def reached(line, edges, times, above=0):
    """Read ten times a FIFO of 1 ms whose line rises at a level of 6, or above it."""
    found = []
    for t in times:
        # the sixth (or seventh) of this round's samples, of which 8 were made
        line.told = [t - (2 - above) * MS - MS // 3]
        found.append(edges.reached(8, t, t + 1000, MS * 1.05))
        edges.drained(t + 100_000)
    return found


@pytest.mark.parametrize('above', [0, 1])
def test_a_watermark_is_found_out_whatever_the_document_says(line, edges, above):
    found = reached(line, edges, range(20 * MS, 180 * MS, 8 * MS), above)
    assert found[:7] == [None] * 7
    assert {edge.back for edge in found[8:]} == {2 - above}


def test_what_happens_while_the_fifo_is_emptied_is_not_used(line, edges):
    reached(line, edges, range(20 * MS, 180 * MS, 8 * MS))
    edges.drained(190 * MS)
    line.told = [189 * MS]
    assert edges.reached(8, 191 * MS, 191 * MS + 1, MS) is None
    # two are one too many
    line.told = [192 * MS, 193 * MS]
    assert edges.reached(8, 194 * MS, 194 * MS + 1, MS) is None


def test_what_came_before_the_beginning_is_forgotten(line, edges):
    line.told = [9 * MS]
    edges.begin()
    assert edges.newest(9 * MS + 1000, 9 * MS + 2000, MS) is None


def test_used_and_unused_are_counted(line):
    counters = Counter()
    edges = Edges(line, counters)
    line.told = [9 * MS]
    edges.newest(9 * MS + 1000, 9 * MS + 2000, MS)
    edges.newest(10 * MS + 1000, 10 * MS + 2000, MS)
    assert counters == {'edges': 1, 'edges_unused': 1}
    edges.close()
    assert line.closed
