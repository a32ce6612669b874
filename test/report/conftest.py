# SPDX-License-Identifier: Apache-2.0
"""The Python part of Bokeh reads our figures: it knows every name and every kind of value."""

from imu_bench.offline.recordings import Recording
import pytest


def read(figure):
    """Return Bokeh's own object of a figure; raise for what Bokeh does not know."""
    from bokeh.core.serialization import Deserializer
    import bokeh.models
    import bokeh.plotting  # noqa: F401, figures are known once it is imported
    from imu_bench.offline.presentation.bokeh_models import document

    roots = document(figure, 'p')[1]
    check_settings(roots)
    return Deserializer().deserialize(roots)[0]


def check_settings(encoded):
    """Raise for a setting that Bokeh's reader would leave out with a warning in its log."""
    from bokeh.model import Model

    if isinstance(encoded, list):
        for item in encoded:
            check_settings(item)
    elif isinstance(encoded, dict):
        if encoded.get('type') == 'object':
            known = Model.model_class_reverse_map[encoded['name']].properties()
            unknown = encoded['attributes'].keys() - known
            if unknown:
                raise ValueError(f'{encoded["name"]} has no {unknown}')
        for item in encoded.values():
            check_settings(item)


@pytest.fixture(scope='session')
def read_by_bokeh():
    return read


@pytest.fixture(scope='session')
def recorded():
    """Return what makes a recording of samples, as it comes out of a healthy bag."""

    def make(samples, **changes):
        fields = {
            'source': 'night.mcap', 'topic': '/imu', 'samples': samples, 'receive_ns': None,
            'frame_id': 'imu_link', 'announced': len(samples), 'stored': len(samples),
            'left_out': 0, 'notes': (), 'stamp_source': 'header', 'stamp_reason': 'they increase',
        }  # fmt: skip
        return Recording(**(fields | changes))

    return make
