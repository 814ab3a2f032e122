"""Uses of a model beside predicting.

=================  =====================================================================
``feedforward``    efforts and pressures of a motion file, for the arm's controller
``energy``         work that the drives do in a motion, and what friction takes of it
``overload``       collisions and overloads: the residual of now against its band
``payload``        the mass at the tip as a signal with its standard deviation
=================  =====================================================================
"""
