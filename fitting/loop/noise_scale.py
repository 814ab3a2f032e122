"""Where no motion was recorded twice, and while rods are unpinned: the size of the noise, from the fitted rows.

The spectrum of a noise that was never measured comes from what a flexible model leaves at the full rate, and that holds
more and less than the noise of the fitted rows: reversals and short rests, whose rows are not fitted, the model's error
where splines in the joint's own motion do not follow it, the filter's edge. Its shape may be right and its size be off
by ten, either way: then nothing can be found, or everything is. So each joint's noise is scaled until the base model
leaves of its fitted rows what noise of that size leaves. A missing effect is part of it; it has to exceed this.

So it is with free cylinders, which have no more noise than the same ones with their links: theirs is taken where what
is left of their rows is far less, and an effect in them cannot have made it.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from daq.messages import Sentence
from fitting.arrays import FloatArray
from fitting.regression.design import Design, NoiseModel
from fitting.regression.streamed import fit_rows
from fitting.signals.spectrum import Whitening

#: Fits: weights between joints change with the sizes.
_PASSES = 2
#: Noise of free cylinders over that with the links from which on they are taken for alike.
FAR_LESS = 0.5
#: Factor from which on it is reported.
REPORTABLE = 1.5


def on_fitted_rows(
    design: Design, noise: NoiseModel, fitted: Sequence[int], anew: Collection[int] | None = None
) -> tuple[NoiseModel, tuple[float, ...]]:
    """Scale the noise to the size of the fitted rows, and return each joint's factor (n,).

    A measured noise is left as it is. Of the others that of the joints ``anew`` was estimated; None: of all.
    """
    factors = np.ones(len(noise.whitenings))
    if noise.measured and not noise.unloaded:
        return noise, tuple(factors.tolist())
    # White inside the band, and nothing beyond it.
    share = min(1.0, 2.0 * design.bank.bandwidth_hz / design.bank.reduced_rate_hz)
    for _ in range(_PASSES):
        fit = fit_rows(design, noise, fitted)[0]
        spent = float(np.count_nonzero(fit.determined)) / max(sum(map(len, fit.residual)), 1)
        moved = np.ones((2, len(factors)))
        for joint in range(len(factors)) if anew is None else anew:
            counts = [np.count_nonzero(design.kept(noise, joint, index)) for index in fitted]
            loaded = np.repeat([design.segments[index].loaded or not noise.unloaded for index in fitted], counts)
            for there in (False,) if noise.measured else (False, True):
                own = fit.residual[joint][: len(loaded)][loaded == there]
                if own.any():
                    moved[int(there), joint] = np.sqrt(np.mean(own**2) / max(1.0 - spent, 0.1) / share)
        factors *= moved[1]
        noise = replace(noise, whitenings=_sized(noise.whitenings, moved[1]), unloaded=_sized(noise.unloaded, moved[0]))
    pairs = zip(noise.whitenings, noise.unloaded, strict=False)
    quiet = tuple(own if own.std < FAR_LESS * loaded.std else loaded for loaded, own in pairs)
    return replace(noise, unloaded=quiet), tuple(factors.tolist())


def _sized(noise: Sequence[Whitening], factors: FloatArray) -> tuple[Whitening, ...]:
    return tuple(
        own if factor == 1.0 else replace(own, innovation=own.innovation * factor, std=own.std * factor)
        for own, factor in zip(noise, factors.tolist(), strict=False)
    )


def words(names: Sequence[str], factors: Sequence[float]) -> list[str]:
    """Report noises that were far off, a line per joint."""
    return [
        Sentence("fitting.no_motion_recorded_twice", joint=name, factor=1 / factor)
        for name, factor in zip(names, factors, strict=True)
        if not 1 / REPORTABLE < factor < REPORTABLE
    ]
