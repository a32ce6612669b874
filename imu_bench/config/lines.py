# SPDX-License-Identifier: Apache-2.0
"""Lines of GPIO chips, as settings name them."""

from __future__ import annotations

import re
from typing import Any

from imu_bench.config.schema import Setting
from imu_bench.errors import ConfigError

_NAME = re.compile(r'(?:/dev/)?(gpiochip\d+):(\d+|[A-Za-z_][\w.-]*)')


def parse_line(text: str) -> tuple[str, int | str]:
    """
    Return the device of a GPIO chip, and the number or the name of a line.

    Raises
    ------
    ConfigError
        If the text names none.

    Examples
    --------
    >>> parse_line('gpiochip0:17'), parse_line('gpiochip4:GPIO27')
    (('/dev/gpiochip0', 17), ('/dev/gpiochip4', 'GPIO27'))
    """
    found = _NAME.fullmatch(text)
    if found is None:
        raise ConfigError(
            f'{text!r} names no line; write chip and line like gpiochip0:17 (gpioinfo lists them)'
        )
    chip, line = found.groups()
    return f'/dev/{chip}', int(line) if line.isdigit() else line


class LineSetting(Setting):
    """A setting that names a line, or none."""

    @property
    def constraint(self) -> str:
        """What is allowed, in words."""
        return 'chip and line of a GPIO, like gpiochip0:17, or empty'

    def check(self, value: object) -> Any:
        """Return the text."""
        text = super().check(value)
        if text:
            parse_line(text)
        return text
