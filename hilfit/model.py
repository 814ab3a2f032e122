"""The corrected model of an arm, to calculate with."""

from __future__ import annotations

import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, Literal, ParamSpec, TypeVar, overload

import numpy as np
import numpy.typing as npt

from fitting.model import motion, simulation
from fitting.model.arm_model import ArmModel, over_time
from fitting.model.codec import load_model, save_model
from fitting.model.export import export_model
from fitting.model.prediction import Predicted, load_recording, predict
from hilfit.recording import Recording
from hilfit.shown import parameters_html

FloatArray = npt.NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., Any])
Given = TypeVar("Given")
Asked = ParamSpec("Asked")


def _with_sections_of(described: Callable[..., Any]) -> Callable[[Function], Function]:
    """Add the sections of a docstring (parameters, errors) of the function behind to its own."""

    def add(function: Function) -> Function:
        text = inspect.getdoc(described) or ""
        section = re.search(r"^(Parameters|Raises)\n-+$", text, re.MULTILINE)
        own, head = inspect.getdoc(function) or "", "Parameters\n----------\n"
        if section is not None:
            rest = text[section.start() :]
            own = f"{own}\n{rest.removeprefix(head)}" if head in own else f"{own}\n\n{rest}"
        function.__doc__ = own
        return function

    return add


def _of_content(function: Callable[Concatenate[ArmModel, Asked], Given]) -> Callable[Concatenate[Model, Asked], Given]:
    """Make a function of a model's content a method of the model: same arguments, result and text."""

    @wraps(function)
    def asked(model: Model, /, *arguments: Asked.args, **named: Asked.kwargs) -> Given:
        return function(model.content, *arguments, **named)

    return asked


@dataclass(frozen=True, repr=False)
class Model:
    """A corrected model: rigid body, drives, effects and laws, with the uncertainty of all parameters.

    Motions are (N, n), rows being samples, or (n,) for one; rad or m, N m or N, s. A model with effects that need the
    motion before a moment (presliding, films, a swinging liquid; :attr:`over_time` names them) asks for times that rise
    in even steps, at any rate. What sensors do to a reading is never in an effort.

    Attributes
    ----------
    content : all that it holds
    """

    content: ArmModel

    @classmethod
    def load(cls, path: str | Path) -> Model:
        """Read a model.

        Parameters
        ----------
        path : of ``model.json``, or a report's folder with one

        Raises
        ------
        InputError
            One line: file, key, what is wrong and what to do.
        """
        return cls(load_model(path))

    def save(self, path: str | Path) -> Path:
        """Write the model as JSON, whole or not at all; errors as of :meth:`load`.

        Parameters
        ----------
        path : of the file
        """
        return save_model(path, self.content)

    def __repr__(self) -> str:
        return f"Model({self.content.machine.name}: {len(self.joints)} joints, {len(self.parameters)} parameters)"

    def _repr_html_(self) -> str:
        return parameters_html(self.parameters)

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the joints, base to tip."""
        return self.content.joints

    @property
    def parameters(self) -> Mapping[str, tuple[float, float, str]]:
        """Value, standard deviation and unit of every parameter, by name."""
        own = self.content
        return {
            name: (float(value), float(std), unit)
            for name, value, std, unit in zip(own.parameter_names, own.theta, own.std, own.parameter_units, strict=True)
        }

    @property
    def over_time(self) -> tuple[str, ...]:
        """Ids of the effects that need the motion before a moment."""
        return tuple(term.id for term in self.content.terms if over_time(term))

    @overload
    def effort(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike,
        t: npt.ArrayLike | None = ...,
        *,
        temperature: npt.ArrayLike | None = ...,
        external: npt.ArrayLike | None = ...,
        return_std: Literal[False] = ...,
    ) -> FloatArray: ...

    @overload
    def effort(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike,
        t: npt.ArrayLike | None = ...,
        *,
        temperature: npt.ArrayLike | None = ...,
        external: npt.ArrayLike | None = ...,
        return_std: Literal[True],
    ) -> tuple[FloatArray, FloatArray]: ...

    @_with_sections_of(motion.on_motion)
    def effort(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike,
        t: npt.ArrayLike | None = None,
        *,
        temperature: npt.ArrayLike | None = None,
        external: npt.ArrayLike | None = None,
        return_std: bool = False,
    ) -> FloatArray | tuple[FloatArray, FloatArray]:
        """Compute joint efforts (N, n) that a motion takes.

        Parameters
        ----------
        return_std : the standard deviation (N, n) of a measured effort as well: what parameters and what the fit left
            of its recordings make together
        """
        found = motion.on_motion(self.content, q, qd, qdd, t, temperature=temperature, external=external)
        return (found.joint_effort(0), found.joint_std(0)) if return_std else found.joint_effort(0)

    @_with_sections_of(motion.on_motion)
    def pressures(
        self,
        q: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike,
        t: npt.ArrayLike | None = None,
        *,
        rod: npt.ArrayLike | None = None,
        temperature: npt.ArrayLike | None = None,
        external: npt.ArrayLike | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        """Compute head and rod pressures (N, n) of a motion, Pa; NaN of a joint without a cylinder.

        Parameters
        ----------
        rod : rod pressure that the machine keeps, (N, n), (n,) or one, Pa; the one that the recordings show at such a
            motion and force if None (NaN where it was not measured)
        """
        found = motion.on_motion(self.content, q, qd, qdd, t, temperature=temperature, external=external)
        return motion.pressures_of(found, rod)

    gravity = _of_content(motion.gravity)
    friction = _of_content(motion.friction)
    inertia_matrix = _of_content(motion.inertia_matrix)
    forward = _of_content(motion.forward)

    def predict(self, recording: Recording | str | Path) -> Predicted:
        """Predict efforts in a recording beside the measured ones, with their 95 % band.

        Parameters
        ----------
        recording : or its file; of the model's machine
        """
        if isinstance(recording, Recording):
            own = recording.of(self.content.machine)
        else:
            own = load_recording(self.content, Path(recording))
        return predict(self.content, own)

    def export(self, to: str, path: str | Path, *, possible: bool = False) -> tuple[str, ...]:
        """Write the model for another program (``hilfit model export``); a line for each part that is not in it.

        Parameters
        ----------
        to : format, as ``hilfit model export --to`` lists them
        path : of the file, or the folder of a format with several
        possible : write the nearest model whose drives have no inertia below zero
        """
        return export_model(self.content, to, Path(path), possible=possible).left_out


simulate = _of_content(simulation.simulate)
tracking = _of_content(simulation.tracking)
