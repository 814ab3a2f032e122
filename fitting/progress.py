"""Progress of a long computation, as whoever started it is kept informed."""

from collections.abc import Callable

#: Called with the share that is done, 0 to 1, and the text of what is being done.
Progress = Callable[[float, str], None]


def quiet(fraction: float, text: str) -> None:
    """Ignore progress."""
