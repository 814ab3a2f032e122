"""Linkages in nodes."""

from __future__ import annotations

import numpy as np

from daq.machine.linkages import Direct, Linkage, Polynomial, Rack, ThreePin, reduced
from fitting.arrays import FloatArray
from fitting.model.export.tracing.moment import Value


def linkage_of(linkage: Linkage, q: Value) -> tuple[Value, Value, Value]:
    """Piston position, lever arm and its slope at a joint position: see :mod:`fitting.arm.linkage`."""
    linkage = reduced(linkage)
    if isinstance(linkage, ThreePin):
        a, b, angle = linkage.a, linkage.b, q + linkage.offset
        product = a * b
        cosine, sine = angle.cos(), angle.sin()
        length = ((a * a + b * b) - 2.0 * product * cosine).sqrt()
        r = product * sine / length
        return length - linkage.retracted, r, (product * cosine - r * r) / length
    if isinstance(linkage, Rack):
        return linkage.radius * (q - linkage.zero), linkage.radius, 0.0
    if isinstance(linkage, Polynomial):
        coefficients = np.asarray(linkage.coefficients)
        of = np.polynomial.polynomial
        return tuple(_horner(of.polyder(coefficients, order), q) for order in range(3))
    assert isinstance(linkage, Direct)
    return q, 1.0, 0.0


def _horner(coefficients: FloatArray, q: Value) -> Value:
    total: Value = 0.0
    for value in coefficients[::-1].tolist():
        total = total * q + value
    return total
