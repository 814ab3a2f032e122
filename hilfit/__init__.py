"""hilfit in a program or a notebook: identify an arm, and use the model.

::

    import hilfit

    machine = hilfit.Machine.load("my-arm.yaml")
    result = hilfit.identify(machine, train=["train-1.parquet"], validate=["validate.parquet"])
    result.report["loop"]["verdict"]
    tau, std = result.model.effort(q, qd, qdd, return_std=True)
    result.model.save("model.json")

Arrays are (N, n): one row per sample, one column per joint; SI units. Bad input raises :class:`hilfit.InputError` with
one line that says what to do.
"""

from daq.errors import HilfitError, InputError
from fitting.model.prediction import Predicted
from fitting.model.simulation import Simulated
from hilfit.machine import Machine
from hilfit.model import Model, simulate, tracking
from hilfit.recording import Recording
from hilfit.result import Result, identify
from hilfit.valve import ValveResult, identify_valve

__all__ = [
    "HilfitError",
    "InputError",
    "Machine",
    "Model",
    "Predicted",
    "Recording",
    "Result",
    "Simulated",
    "ValveResult",
    "identify",
    "identify_valve",
    "simulate",
    "tracking",
]
