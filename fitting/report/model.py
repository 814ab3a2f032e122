"""Values of the figures of a report; no drawing."""

from __future__ import annotations

from dataclasses import dataclass

from fitting.arrays import FloatArray


@dataclass(frozen=True)
class JointDiagnostics:
    """Residual joint effort of one joint.

    Attributes
    ----------
    joint, unit : the joint, and its effort unit
    fit_before, fit_after : 100 (1 - norm of the residual / norm of the effort about its mean), %
    time, measured : (N,) s from the first row, all segments; measured effort
    before, after : (N,) measured minus predicted effort without and with what was added
    lag : (K,) s, from 0
    auto : (K,) autocorrelation of ``after``
    cross_lag, cross : (2 K - 1,) s; correlation of ``after`` with the drive's speed that much earlier
    bound : correlations within it are those of white noise, 99 %
    frequency, density_before, density_after : (M,) Hz; power spectral densities, unit^2/Hz
    """

    joint: str
    unit: str
    fit_before: float
    fit_after: float
    time: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray
    lag: FloatArray
    auto: FloatArray
    cross_lag: FloatArray
    cross: FloatArray
    bound: float
    frequency: FloatArray
    density_before: FloatArray
    density_after: FloatArray

    @property
    def course(self) -> Course:
        """Measured and predicted effort over all samples."""
        return Course(
            self.joint, self.unit, self.time, self.measured, self.measured - self.before, self.measured - self.after
        )


@dataclass(frozen=True)
class Scatter:
    """Residual against the variable that is blamed, before and after, ``N`` samples of the validation motion.

    Attributes
    ----------
    joint : the joint whose residual it is
    variable, unit : the variable (``piston_position``), and its unit
    x : (N,) the variable
    before, after : (N,) measured minus predicted effort without and with what was added
    law_x, law_y, law_std : (K,) the law that was found, and its standard deviation; empty where there is none
    effort_unit : unit of the residuals and of the law
    direction : (N,) sign of the speed (0 at rest) where the law differs between the directions, None where it is
        the same: an odd law averages out unless both ways are drawn apart
    partial : (N,) ``after`` with the law's own part put back: what the law has to explain, so points lie on it; None
        where that was not worked out
    law_back : (K,) the law while the speed is negative (``-law_y`` for an odd one), None where it is the same
    """

    joint: str
    variable: str
    unit: str
    x: FloatArray
    before: FloatArray
    after: FloatArray
    law_x: FloatArray
    law_y: FloatArray
    law_std: FloatArray
    effort_unit: str
    direction: FloatArray | None = None
    law_back: FloatArray | None = None
    partial: FloatArray | None = None


@dataclass(frozen=True)
class Course:
    """Effort of one joint over ``N`` samples of the validation motion, measured and predicted.

    Attributes
    ----------
    joint, unit : the joint, and its effort unit
    time : (N,) s; where it goes back another part of the recordings begins
    measured : (N,) effort
    before, after : (N,) *predicted* effort without and with what was added
    """

    joint: str
    unit: str
    time: FloatArray
    measured: FloatArray
    before: FloatArray
    after: FloatArray


@dataclass(frozen=True)
class FrictionCurve:
    """Friction of one joint's drive over speed.

    Attributes
    ----------
    joint : the joint
    unit_x, unit_y : units of speed and force
    speed, force, std : (N,) the curve fitted without any effect, and its standard deviation
    after : (N,) the curve of the final model, None where nothing changed
    """

    joint: str
    unit_x: str
    unit_y: str
    speed: FloatArray
    force: FloatArray
    std: FloatArray
    after: FloatArray | None = None


@dataclass(frozen=True)
class Figures:
    """All figures of a report."""

    scatter: tuple[Scatter, ...] = ()
    worst: Course | None = None
    friction: tuple[FrictionCurve, ...] = ()
    diagnostics: tuple[JointDiagnostics, ...] = ()
