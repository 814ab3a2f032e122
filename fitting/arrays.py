"""Types of arrays, one name for each, arrays that are there when asked for, and the sizes of columns."""

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


def unit_gram(gram: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Scale Gram matrices (.., k, k) to columns of unit size; return their sizes (.., k) as well.

    A column that the base takes whole leaves rounding, of either sign, and beside others more than it has itself: where
    its square is none it is nothing, and its size is infinite.
    """
    squares = np.einsum("...aa->...a", gram)
    size = np.where(squares > 0.0, np.sqrt(np.abs(squares)), np.inf)
    return gram / size[..., :, None] / size[..., None, :], size
