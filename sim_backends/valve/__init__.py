"""Valves behind the cylinders: commands move the arm, integrated in time with oil and load.

===============  =====================================================================================================
``truth``        what valves, oil, supply and load really are
``load``         equations of motion of arms in a plane and of gantries, many machines side by side
``spools``       command to stroke: delay, hysteresis, stick, spring-mass-damper
``lands``        flow through the edges: dead band, curve, orifice or compensator, throttles, counterbalance valves
``chambers``     capacities, leaks, relief, friction, end stops; pumps
``plant``        all of it advanced together (:class:`~sim_backends.valve.plant.ValvePlant`)
``machines``     a compensated bench, a crane with orifice valves, an excavator on one pump, drawn at random
``effects``      undeclared effects, each in every physical form that it may have, as changes of the truth
``motion``       what the simulated controller does: staircases, ladders, sines, rest, work
``recording``    programmes run on plants, and what transducers record of them; cases on disk
``tracking``     a path followed through an inverse of the valves
===============  =====================================================================================================
"""
