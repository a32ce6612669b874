# SPDX-License-Identifier: Apache-2.0
"""A file is there completely or not at all, and an error names it."""

import errno
import os

from imu_bench.offline.whole_files import whole, write_text
import pytest


def full_disk(draft):
    """Write a part, then fail as a full disk does."""
    draft.write_text('half')
    raise OSError(errno.ENOSPC, 'No space left on device')


def test_what_was_there_is_kept_if_the_disk_is_full(tmp_path):
    path = tmp_path / 'a.json'
    path.write_text('before')
    with pytest.raises(OSError, match='No space left') as caught, whole(path) as draft:
        full_disk(draft)
    assert caught.value.filename == str(path)
    assert path.read_text() == 'before'
    assert os.listdir(tmp_path) == ['a.json']


def test_nothing_is_left_if_writing_is_stopped(tmp_path):
    with pytest.raises(KeyboardInterrupt), whole(tmp_path / 'a.html') as draft:
        draft.write_text('half')
        raise KeyboardInterrupt
    assert os.listdir(tmp_path) == []


def test_a_link_stays_a_link(tmp_path):
    path, link = tmp_path / 'a', tmp_path / 'b'
    path.write_text('before')
    link.symlink_to(path)
    write_text(link, 'µ')
    assert link.is_symlink()
    assert path.read_text(encoding='utf-8') == 'µ'


def test_a_device_is_written_to_directly():
    write_text(os.devnull, 'x')
    assert not os.path.isfile(os.devnull)
    assert os.path.exists(os.devnull)
