"""A recording of the plain bench with nothing wrong in it."""

from __future__ import annotations

import numpy as np

RATE = 50.0
ROWS = 500  # 10 s, above the 8 s that are asked for
Columns = dict[str, np.ndarray]


def motion(rows: int = ROWS) -> Columns:
    """Columns in the declared units (deg, mm, bar, degC); rack: x = 0.1 m (q + 1.2)."""
    rng = np.random.default_rng(1)
    t = np.arange(rows) / RATE
    q = 0.8 * np.sin(2 * np.pi * 0.2 * t)
    return {
        "time": t,
        "j1.angle": np.rad2deg(q),
        "j1.piston": 1e3 * 0.1 * (q + 1.2),
        "j1.head": 60 + 20 * np.sin(t) + 0.1 * rng.standard_normal(rows),
        "j1.rod": 30 + 10 * np.cos(t) + 0.1 * rng.standard_normal(rows),
        "oil": np.full(rows, 45.0),
    }
