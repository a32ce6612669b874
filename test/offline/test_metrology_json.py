# SPDX-License-Identifier: Apache-2.0
"""What is written of a noise model draws the same curve when it is read."""

from dataclasses import replace
import json

from imu_bench.metrology import allan
from imu_bench.metrology.noise_fit import fitted
from imu_bench.offline.analysis.json_forms import model_from_json, model_to_json
import numpy as np
import pytest
from scipy import signal


@pytest.mark.parametrize('floor', [0.0, 0.01])
def test_a_low_pass_filter_survives(floor):
    x = np.random.default_rng(1).standard_normal(50_000)
    model = fitted(allan.deviation(signal.lfilter(*signal.butter(2, 0.2), x), 100.0, unit='rad/s'))
    assert model.low_pass is not None
    model = replace(model, low_pass=replace(model.low_pass, floor=floor))
    document = {
        'unit': model.unit,
        'coefficients': {name: e.to_json() for name, e in model.coefficients.items()},
        'model': model_to_json(model),
    }
    again = model_from_json(json.loads(json.dumps(document)))
    assert (again.low_pass, again.bandwidth) == (model.low_pass, model.bandwidth)
    tau = np.array([0.01, 0.1, 10.0])
    np.testing.assert_array_equal(again.deviation(tau), model.deviation(tau))
