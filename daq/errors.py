"""Errors of the acquisition side.

::

    HilfitError                 anything that this product raises on purpose
    ├── InputError              a file, key, channel or option is wrong: one line, exit code 2
    │   ├── MachineFileError    the machine file
    │   └── RecordingError      a recording
    └── AcquisitionError        a bus or a device (exit code 1)
        ├── CommissioningError  a device is not what the machine file says
        ├── BusError            the bus itself failed
        └── StorageError        a recording cannot be written
            └── DiskFullError   because the disk is full

The text of every one of them is a single line that names the file, key, channel or node and says what to do.
"""

from __future__ import annotations

from typing import Any

from daq.messages import Sentence, is_code


class HilfitError(Exception):
    """Anything that hilfit raises on purpose; its text is one line that a user can act on.

    Parameters
    ----------
    text : the line; or the code of a message (see :mod:`daq.messages`), whose ``values`` follow
    """

    def __init__(self, text: str = "", /, **values: Any) -> None:
        super().__init__(Sentence(text, **values) if values or is_code(text) else text)


def first_line(error: Exception | None) -> str:
    """Return the first line of an error's text, or its kind; some libraries add tracebacks."""
    text = str(error)
    line = text.split("\n")[0].split("Traceback (most recent")[0].strip()
    return text if line == text != "" else line or type(error).__name__


class InputError(HilfitError):
    """A file, key, channel or option is wrong. The command line ends with exit code 2."""


class BadValueError(ValueError):
    """A value that cannot be, with the parameters of :class:`HilfitError`; pydantic's validators may raise it.

    ``at`` is its place: keys, and numbers in lists, that lead to it from the part that is looked at.
    """

    def __init__(self, code: str, /, *, at: tuple[str | int, ...] = (), **values: Any) -> None:
        super().__init__(Sentence(code, **values))
        self.at = at


class MachineFileError(InputError):
    """A machine file is unreadable, has an unknown key, or describes a machine that cannot exist."""


class RecordingError(InputError):
    """A recording cannot be used: unreadable, of another machine, with gaps, saturated or too short."""


class AcquisitionError(HilfitError):
    """A bus or a device failed."""


class CommissioningError(AcquisitionError):
    """A device did not answer, or is not what the machine file says it is."""


class BusError(AcquisitionError):
    """The bus itself failed: interface gone, connection refused, controller in bus-off."""


class StorageError(AcquisitionError):
    """A recording cannot be written although its place was good when it began.

    Attributes
    ----------
    operation : what failed: ``write``, ``sync``, ``sealing``, ``read`` or ``rename``
    """

    def __init__(self, line: str, operation: str) -> None:
        super().__init__(line)
        self.operation = operation


class DiskFullError(StorageError):
    """The disk is full."""
