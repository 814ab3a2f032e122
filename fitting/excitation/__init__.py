"""Excitation: motions that tell the parameters.

=================== =====================================================================
``fourier``         series that start and end at rest
``objective``       information of a motion, its condition number, and the gradient
``limits``          limits and how much of them is used; supply flow and chamber pressure
``search``          the criterion as a function of free coefficients, and its minimisation
``design``          one motion, or a sequence of motions that complement each other
``cylinders``       signals for free cylinders (stage 1): band-limited, and a staircase
=================== =====================================================================
"""

from fitting.excitation.cylinders import CylinderExcitation, CylinderOptions, design_cylinder_motion
from fitting.excitation.design import Excitation, design_motion, design_sequence, information_of
from fitting.excitation.limits import HydraulicLimits, LimitUse
from fitting.excitation.objective import condition_of_information, information
from fitting.excitation.problem import ExcitationOptions

__all__ = [
    "CylinderExcitation",
    "CylinderOptions",
    "Excitation",
    "ExcitationOptions",
    "HydraulicLimits",
    "LimitUse",
    "condition_of_information",
    "design_cylinder_motion",
    "design_motion",
    "design_sequence",
    "information",
    "information_of",
]
