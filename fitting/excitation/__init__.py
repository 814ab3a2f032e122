"""Excitation: motions that determine the parameters.

=================== =====================================================================
``fourier``         series that start and end at rest, and random motions, for searches without gradients
``objective``       information of a motion, its condition number, and the gradient
``limits``          limits and how much of them is used; supply flow and chamber pressure
``problem``         an unconstrained problem: free coefficients in, a motion inside its limits out
``search``          criterion, penalties, and the minimisation from competing starts
``design``          one motion, or a sequence that complement each other and what is determined already
``cylinders``       signals for free cylinders (stage 1): band-limited, and a staircase
``staircase``       constant speeds, slow to fast
``experiments``     motions that separate effects: staircases, reversals, two poses, a neighbour
=================== =====================================================================
"""
