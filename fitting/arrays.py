"""Types of arrays, one name for each that functions here take and give, and arrays that are there when asked for."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias, TypeVar, overload

import numpy as np
import numpy.typing as npt

FloatArray: TypeAlias = npt.NDArray[np.float64]
BoolArray: TypeAlias = npt.NDArray[np.bool_]
#: Numbers of rows or columns.
IntArray: TypeAlias = npt.NDArray[np.intp]

_Item = TypeVar("_Item")


class LateSequence(Sequence[_Item]):
    """``count`` items that ``item`` gives by place when one is asked for, read from a file or computed."""

    def __init__(self, item: Callable[[int], _Item], count: int) -> None:
        self._item, self._places = item, range(count)

    def __len__(self) -> int:
        return len(self._places)

    @overload
    def __getitem__(self, place: int) -> _Item: ...

    @overload
    def __getitem__(self, place: slice) -> Sequence[_Item]: ...

    def __getitem__(self, place: int | slice) -> _Item | Sequence[_Item]:
        places = self._places[place]
        return self._item(places) if isinstance(places, int) else [self._item(each) for each in places]
