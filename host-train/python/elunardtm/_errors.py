"""Exceptions. The text is the one line that the program ``elunar`` prints behind ``ERROR:``."""


class Error(Exception):
    """What a call cannot do. Memory that is refused is a :class:`MemoryError`, a defect of this package a :class:`RuntimeError`."""


class UsageError(Error, ValueError):
    """Arguments that cannot be met, or an output that must not be written."""


class InputError(Error, ValueError):
    """An input that is missing, broken, or does not serve. The same call never succeeds on it."""


class TryAgainError(Error):
    """What may pass: another run that writes the output, a full disk, another error of the system."""


class Warning(UserWarning):  # noqa: A001
    """A result that is probably not what was meant."""
