"""Figures of the page of the claims, as SVG."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from benchmarks.measured.figures import svg
from fitting.arrays import FloatArray

if TYPE_CHECKING:
    from benchmarks.paper.runs import ArmRun, CylinderRun
    from benchmarks.paper.stribeck import StribeckRun


_TRUTH, _BASE, _CORRECTED = "#333333", "#b3541e", "#1f6f8b"
#: Two-sided 95 % quantile of the normal distribution.
_Z95 = 1.96


def friction_columns(v: FloatArray) -> FloatArray:
    """Compute columns (N, 3) of ``f_c``, ``f_v`` and ``f_s`` at piston speeds (N,), m/s."""
    return np.column_stack([np.sign(v), v, np.cbrt(v)])


def curve(own: CylinderRun, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute stage 1's friction (N,) in N at piston speeds, its standard deviation, and the truth."""
    k = [own.names.index(name) for name in ("f_c", "f_v", "f_s")]
    B = friction_columns(v)
    std = np.sqrt(np.einsum("ni,ij,nj->n", B, own.covariance[np.ix_(k, k)], B))
    return np.asarray(B @ own.theta[k]), np.asarray(std), np.asarray(B @ own.truth[k])


def cylinders(own: ArmRun) -> str:
    """Plot friction over piston speed of every cylinder: stage 1, its 95 % band, and the truth."""

    def draw(figure: Any) -> None:
        for ax, each in zip(figure.subplots(2, 3).flat, own.cylinders, strict=False):
            half = np.geomspace(0.01 * each.fastest, each.fastest, 50)
            v = np.concatenate([-half[::-1], half])
            found, std, truth = curve(each, v)
            ax.fill_between(1e3 * v, found - _Z95 * std, found + _Z95 * std, color=_CORRECTED, alpha=0.25, linewidth=0)
            ax.plot(1e3 * v, found, color=_CORRECTED, linewidth=1.3, label="stage 1, 95 % band")
            ax.plot(1e3 * v, truth, "--", color=_TRUTH, linewidth=1.0, label="truth")
            ax.set_title(each.joint, fontsize=10)
        figure.axes[0].legend(loc="upper left", fontsize=8)
        for ax in figure.axes[3:]:
            ax.set_xlabel("piston speed [mm/s]")
        for ax in (figure.axes[0], figure.axes[3]):
            ax.set_ylabel("friction [N]")

    return svg(draw, 9.0, 5.0)


def stribeck(own: StribeckRun) -> str:
    """Plot friction with a bump that the base model lacks, before and after the loop."""

    def draw(figure: Any) -> None:
        ax = figure.subplots()
        v = 1e3 * own.speed
        ax.plot(v, own.base, color=_BASE, linewidth=1.3, label=f"base model: {own.before:.1f} N off")
        ax.plot(v, own.corrected, color=_CORRECTED, linewidth=1.3, label=f"after the loop: {own.after:.1f} N off")
        ax.plot(v, own.truth, "--", color=_TRUTH, linewidth=1.0, label="truth")
        ax.set_xlabel("piston speed [mm/s]")
        ax.set_ylabel("friction with damping [N]")
        ax.legend(loc="upper left")

    return svg(draw, 6.4, 3.8)
