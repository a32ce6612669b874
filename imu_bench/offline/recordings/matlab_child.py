# SPDX-License-Identifier: Apache-2.0
"""
Variables of a .mat file as .npy files: a program of its own, since a damaged file can crash it.

The reader of SciPy is compiled code that trusts what a file says of itself.
``python -m imu_bench.offline.recordings.matlab_child FILE FOLDER VARIABLE…`` prints the names of
the arrays as JSON, in the order of the files 0.npy, 1.npy, …
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
import json
from pathlib import Path
import sys
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.io import loadmat


def main(file: str, folder: str, *variables: str) -> None:
    names: list[str] = []
    for key in variables:
        entry = loadmat(file, variable_names=[key], simplify_cells=True).get(key)
        for name, value in _leaves(key, entry):
            np.save(Path(folder) / f'{len(names)}.npy', value, allow_pickle=False)
            names.append(name)
    sys.stdout.write(json.dumps(names))


def _leaves(name: str, value: object) -> Iterator[tuple[str, npt.NDArray[Any]]]:
    """Yield the arrays in a struct and in its structs, under dotted names."""
    if isinstance(value, Mapping):
        for key, entry in value.items():
            yield from _leaves(f'{name}.{key}', entry)
    elif isinstance(value, np.ndarray) and value.dtype.kind in 'iuf' and value.size:
        yield name, value


if __name__ == '__main__':
    try:
        main(*sys.argv[1:])
    except Exception as problem:  # scipy raises whatever a damaged file leads it to
        sys.exit(' '.join(str(problem).split()) or type(problem).__name__)
