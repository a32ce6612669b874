# SPDX-License-Identifier: Apache-2.0
"""
The error tree of the bench.

Each leaf is also the builtin that a Python user expects, so that both
``except BenchError`` and ``except ValueError`` do what they say.
The text of every error names what is wrong, where, and what to do next.
"""

from collections.abc import Iterator
from contextlib import contextmanager


class BenchError(Exception):
    """Root of every error that the bench raises on purpose."""


class ConfigError(BenchError, ValueError):
    """A setting, parameter or configuration file is not acceptable."""


class DataError(BenchError, ValueError):
    """Numbers handed to the metrology core cannot give the result asked for."""


class UnitError(BenchError, ValueError):
    """A unit is unknown, or two units do not measure the same quantity."""


class RecordingError(BenchError, ValueError):
    """A recording cannot be read, or holds nothing that can be analysed."""


class TooShort(RecordingError):
    """A topic has fewer samples than can be analysed."""


class RecordingOver(RecordingError):
    """A recording that is played has no more."""


class BusError(BenchError, OSError):
    """A transfer on a bus failed."""


class NoAnswer(BusError):
    """Nothing acknowledged at the address."""


class BusBusy(BusError):
    """The bus is held by somebody else, or a line is stuck."""


class PermissionDenied(BusError, PermissionError):
    """The device file exists but this user may not open it."""


class FrameError(BenchError, ValueError):
    """Bytes on the wire do not form a valid frame."""


class ChecksumError(FrameError):
    """A frame arrived whole, with a checksum that does not match."""


class IdentityError(BenchError, RuntimeError):
    """Something answers at the address, but it is not the expected chip."""


class NotReady(BenchError, RuntimeError):
    """The device or component was asked before it had anything to give."""


@contextmanager
def needed(package: str, why: str) -> Iterator[None]:
    """
    Say what to install when the import of an optional package inside fails.

    Parameters
    ----------
    package : str
        Its name for pip.
    why : str
        What needs it, as the beginning of a sentence.

    Raises
    ------
    NotReady
        If the package is not installed.

    Examples
    --------
    >>> with needed('nosuch', 'a bag compressed with lz4'):
    ...     import nosuch
    Traceback (most recent call last):
    ...
    imu_bench.errors.NotReady: a bag compressed with lz4 needs nosuch: pip install nosuch
    """
    try:
        yield
    except ImportError as error:
        raise NotReady(f'{why} needs {package}: pip install {package}') from error


def os_error_text(error: OSError) -> str:
    """
    Return what the operating system refused, and for which file.

    Examples
    --------
    >>> os_error_text(FileNotFoundError(2, 'No such file or directory', '/tmp/a/b.json'))
    '/tmp/a/b.json: No such file or directory'
    """
    if error.strerror and error.filename is not None:
        return f'{error.filename}: {error.strerror}'
    return error.strerror or str(error) or type(error).__name__
