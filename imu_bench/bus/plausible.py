# SPDX-License-Identifier: Apache-2.0
"""What words can be right where nothing protects a transfer, as on I²C."""

from __future__ import annotations

import math
from typing import Any

import numpy.typing as npt

MARGIN = 1.125
"""Beyond the range; errors of scale and offset are less, a wrong bit is more."""

NORM_TOLERANCE = 0.02
"""Of the norm of a quaternion, rounding included."""


def plausible(
    force: npt.NDArray[Any], full: float, quaternion: npt.NDArray[Any] | None, one: int
) -> bool:
    """
    Return whether a chip can send this.

    Parameters
    ----------
    force : ndarray, shape (3,)
        Words of an acceleration.
    full : float
        Full scale of them.
    quaternion : ndarray, shape (4,), optional
        All zero is none yet.
    one : int
        Its norm.

    Examples
    --------
    >>> import numpy as np
    >>> plausible(np.array([0, 0, 981]), 3923.0, np.array([16384, 0, 0, 0]), 16384)
    True
    >>> plausible(np.array([0, 0, 981 + 2**14]), 3923.0, None, 16384)
    False
    """
    if max(map(abs, force.tolist())) > MARGIN * full:
        return False
    norm = 0.0 if quaternion is None else math.hypot(*quaternion.tolist())
    return not norm or abs(norm / one - 1) <= NORM_TOLERANCE
