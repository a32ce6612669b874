# SPDX-License-Identifier: Apache-2.0
"""The metadata of bags: every version, and files that are none."""

from __future__ import annotations

from imu_bench.bags import metadata
from imu_bench.errors import RecordingError
import pytest
import yaml


@pytest.mark.data
def test_every_version_there_is_can_be_read(shared_data):
    versions = {}
    for path in sorted(shared_data.glob('rosbag2_test_bags/**/metadata.yaml')):
        found = metadata.read(path)
        versions.setdefault(found.version, []).append(found)
        assert found.storage in ('sqlite3', 'mcap')
        assert found.files
        assert sum(found.counts.values()) == found.message_count
        assert all('/' not in name for name in found.files)
    assert set(versions) == {1, 4, 5, 6, 7, 8}


@pytest.mark.data
def test_compression_is_understood(shared_data):
    bags = shared_data / 'rosbag2_test_bags/galactic-0.9.2/rosbag2_tests/resources'
    for mode in ('file', 'message'):
        found = metadata.read(bags / f'reindex_test_bags/{mode}_compression/metadata.yaml')
        assert (found.compression_mode, found.compression_format) == (mode, 'zstd')


@pytest.mark.parametrize(
    ('text', 'reason'),
    [
        ('', "'NoneType' object is not subscriptable"),
        ('a: [', 'damaged: while parsing'),
        ('rosbag2_bagfile_information: {}', "KeyError('version')"),
        ('rosbag2_bagfile_information: {version: x}', 'invalid literal'),
        ('[1, 2]', 'list indices'),
        ('!!python/object/apply:os.system [ls]', 'damaged: could not determine a constructor'),
        ('\x01', 'damaged: '),
    ],
)
def test_what_is_no_metadata_is_refused_in_one_line(tmp_path, text, reason):
    path = tmp_path / 'metadata.yaml'
    path.write_text(text)
    with pytest.raises(RecordingError) as caught:
        metadata.read(path)
    assert str(caught.value).startswith(str(path))
    assert reason in str(caught.value)
    assert '\n' not in str(caught.value)


def test_a_file_is_replaced_completely_or_not_at_all(tmp_path, monkeypatch):
    path = tmp_path / 'metadata.yaml'
    metadata.write(path, {'version': 9})
    assert yaml.safe_load(path.read_text()) == {'rosbag2_bagfile_information': {'version': 9}}

    def fail(*_args, **_options):
        raise OSError('disk full')

    monkeypatch.setattr('pathlib.Path.write_text', fail)
    with pytest.raises(OSError, match='disk full'):
        metadata.write(path, {'version': 10})
    assert yaml.safe_load(path.read_text()) == {'rosbag2_bagfile_information': {'version': 9}}
