r"""Unloaded and loaded recordings as two witnesses of one effect.

The rod is off its pin (or the arm hangs free) in an `unloaded` recording: what rubs, leaks or reads wrong in the
cylinder is still there, what the joint or the arm does is not. So an effect is fitted with one coefficient for the
unloaded rows and another for the loaded ones, beside a base model that both share::

    b = A beta + [C_u; 0] eta_u + [0; C_l] eta_l + e

With ``Q`` an orthonormal basis of ``A`` (all joints' rows; ``Q_u``, ``Q_l`` its rows of this joint) and ``e`` the base
model's residual, everything needed is the Gram matrix of the projected columns and their scores::

    G = diag(C_u^T C_u, C_l^T C_l) - [Q_u^T C_u, Q_l^T C_l]^T [Q_u^T C_u, Q_l^T C_l],   s = (C_u^T e_u, C_l^T e_l)

    (eta_u, eta_l) = G^-1 s,   covariance G^-1   (whitened rows: unit variance)

What one witness shows is weighed against what it would have shown: ``expected`` is the significance that the *other*
witness's value would have had here. A witness that could not have seen it is silent, and excludes nothing.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt

from daq.messages import Sentence
from fitting.arrays import FloatArray, unit_gram
from fitting.effects.base import Level

Verdict = Literal["both", "different", "gone_unloaded", "only_unloaded", "silent", "neither"]

#: Significance from which on an effect is visible in a witness that shows it, or would have shown it.
VISIBLE = 4.0
#: What is below this significance is not there.
ABSENT = 2.5
#: Two values that differ by so many standard errors are not one value.
APART = 4.0
#: Share of a column's norm below which what the base leaves of it is rounding.
_DEAD = 1e-4


@dataclass(frozen=True)
class Witness:
    """Estimates of the unloaded and the loaded rows of one candidate with ``k`` coefficients.

    Significances are roots of chi-squares, turned into those of one coefficient with the same chance.

    Attributes
    ----------
    verdict : ``both`` (one value explains both), ``different`` (in both, with different values), ``gone_unloaded``
        (loaded only, although the unloaded rows would have shown it), ``only_unloaded`` (the other way round),
        ``silent`` (one of the two could not have seen it), ``neither`` (not significant in either)
    unloaded, loaded : (k,) estimates; zero where the rows show nothing
    unloaded_z, loaded_z : significance of each
    expected_unloaded, expected_loaded : significance that the other witness's value would have had in these rows
    difference_z : significance of the difference of the two
    """

    verdict: Verdict
    unloaded: FloatArray
    loaded: FloatArray
    unloaded_z: float
    loaded_z: float
    expected_unloaded: float
    expected_loaded: float
    difference_z: float

    @property
    def words(self) -> str:
        """One line for the report."""
        z = Sentence("fitting.unloaded_loaded_standard_errors", unloaded_z=self.unloaded_z, loaded_z=self.loaded_z)
        return {
            "both": Sentence("fitting.unloaded_recording_shows_well", z=z),
            "different": Sentence("fitting.both_but_standard_errors", difference_z=self.difference_z, z=z),
            "gone_unloaded": Sentence(
                "fitting.gone_when_unloaded_where", expected_unloaded=self.expected_unloaded, z=z
            ),
            "only_unloaded": Sentence("fitting.when_unloaded", z=z),
            "silent": Sentence(
                "fitting.unloaded_loaded_recordings_cannot",
                expected_unloaded=min(self.expected_unloaded, self.expected_loaded),
            ),
            "neither": Sentence("fitting.significant_neither", z=z),
        }[self.verdict]


def witness(
    columns: FloatArray, residual: FloatArray, orthonormal: FloatArray, unloaded: npt.NDArray[np.bool_]
) -> Witness:
    """Compare the two witnesses on a joint's whitened rows.

    Parameters
    ----------
    columns : (R, k) whitened columns of the candidate
    residual : (R,) whitened residual of the base model (or of the model so far)
    orthonormal : (R, rank) this joint's rows of the orthonormal basis of what was fitted
    unloaded : (R,) True for rows of `unloaded` recordings
    """
    halves = [np.where(mask[:, None], columns, 0.0) for mask in (unloaded, ~unloaded)]
    split = np.hstack(halves)
    inside = orthonormal.T @ split
    gram, score = split.T @ split - inside.T @ inside, split.T @ residual
    squares = np.einsum("ij,ij->j", split, split)  # what is left of a column is compared with these
    k = len(score) // 2
    left = np.diag(gram)
    alive = left > np.maximum(_DEAD**2 * squares, 1e-300)
    scale = np.where(alive, 1.0 / np.sqrt(np.where(alive, left, 1.0)), 0.0)
    # Directions that the data does not determine are left out of the inverse instead of being blown up.
    covariance = np.linalg.pinv(gram * np.outer(scale, scale), rcond=_DEAD**2, hermitian=True) * np.outer(scale, scale)
    values = covariance @ score
    u, v = slice(0, k), slice(k, 2 * k)
    z_u, z_l = (_significance(values[own], covariance[own, own]) for own in (u, v))
    expected_u, expected_l = (_significance(values[other], covariance[own, own]) for own, other in ((u, v), (v, u)))
    apart = covariance[u, u] + covariance[v, v] - covariance[u, v] - covariance[v, u]
    difference = _significance(values[u] - values[v], apart) if alive[u].any() and alive[v].any() else 0.0
    verdict = _verdict(z_u, z_l, expected_u, expected_l, difference)
    return Witness(verdict, values[u], values[v], z_u, z_l, expected_u, expected_l, difference)


def _significance(values: FloatArray, covariance: FloatArray) -> float:
    """Compute the significance of values under a covariance: the normal deviate of equal chance.

    For one coefficient it is the estimate over its standard deviation; for more by Wilson and Hilferty's cube root
    (Proc. Nat. Acad. Sci. 17, 1931). Directions without variance are undetermined and do not count.
    """
    correlation, size = unit_gram(covariance)
    unit = values / size
    chi = max(float(unit @ np.linalg.pinv(correlation, rcond=_DEAD**2, hermitian=True) @ unit), 0.0)
    k = int(np.linalg.matrix_rank(correlation, tol=_DEAD**2 * len(unit), hermitian=True))
    if k <= 1:
        return float(np.sqrt(chi))
    ninth = 2.0 / (9.0 * k)
    return float(max((np.cbrt(chi / k) - (1 - ninth)) / np.sqrt(ninth), 0.0))


def _verdict(z_u: float, z_l: float, expected_u: float, expected_l: float, difference: float) -> Verdict:
    there_u, there_l = z_u >= VISIBLE, z_l >= VISIBLE
    if there_u and there_l:
        return "different" if difference >= APART else "both"
    if there_l and expected_u >= VISIBLE and z_u < ABSENT and difference >= APART:
        return "gone_unloaded"
    if there_u and expected_l >= VISIBLE and z_l < ABSENT and difference >= APART:
        return "only_unloaded"
    if not there_u and not there_l:
        return "neither"
    # One shows it; the other, which would have shown it, half does (both), or could not have.
    visible = expected_u >= VISIBLE if there_l else expected_l >= VISIBLE
    return "both" if visible and difference < APART else "different" if visible else "silent"


def objection(level: Level, own: Witness) -> str:
    """Return why an effect of this level cannot be what its columns' witness saw; empty if there is no objection.

    What sits in the cylinder or in the pressure sensors is there with and without a load.
    """
    return own.words if level != "joint" and own.verdict == "gone_unloaded" else ""
