"""The valve side: from a command to a speed, and back.

==============  ====================================================================================================
``rows``        recordings to command, pressures and filtered speed of an axis
``laws``        laws of the pressure
``effects``     effects of the level "valve", one object each
``model``       structure and columns of the model
``fit``         grid, Gauss and Newton, intervals, profile of the delay; peers of the model
``unknown``     laws of one variable, where no name fits
``choose``      laws, curves and effects chosen on another motion
``checks``      mistakes in what was recorded, and the dead band that a controller compensates already
``inverse``     the model that is handed out: the command for a speed
``identify``    the whole, and its report
``drift``       what a fit leaves of newer motion, and which of its numbers moved
==============  ====================================================================================================
"""
