"""The valve side: from a command to a speed, and back.

==============  ====================================================================================================
``rows``        recordings to command, pressures and filtered speed of an axis
``laws``        laws of the pressure
``effects``     effects of the level "valve", one object each
``model``       structure and columns of the model
``fit``         grid, Gauss and Newton, intervals, profile of the delay
``unknown``     laws of one variable, where no name fits
``choose``      laws, curves and effects by what another motion says
``peers``       a line, an autoregression, a static curve
``controller``  the dead band that a controller compensates already
``checks``      mistakes in what was recorded
``inverse``     the model that is handed out: the command for a speed
``identify``    the whole, and its report
==============  ====================================================================================================
"""
