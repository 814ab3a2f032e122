"""The model that an identification hands over: evaluated, stored, and exported.

=================  =====================================================================================
``arm_model``      what is handed over, as one frozen value
``handover``       made of a finished identification
``codec``          ``model.json`` (schema ``hilfit/model/1``), written and read
``evaluation``     the one path from parameters and motion to efforts and their standard deviations
``motion``         efforts, pressures, friction, gravity and inertia of any motion
``prediction``     the same on a recording, beside what was measured
``simulation``     motion from efforts
``export``         the model in other programs' formats
=================  =====================================================================================
"""
