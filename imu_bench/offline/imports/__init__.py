# SPDX-License-Identifier: Apache-2.0
"""
Recordings of any kind into well-formed ones: bags of ROS 2, CSV, columns.

>>> from pathlib import Path
>>> form_of(Path('night.csv'), None), form_of(Path('night'), None)
('csv', 'mcap')
"""

from imu_bench.offline.imports.job import form_of, FORMS, import_recordings, Imported

__all__ = ['FORMS', 'Imported', 'form_of', 'import_recordings']
