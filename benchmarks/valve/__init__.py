"""How well valves are identified, on plants, effects and motions that are drawn at random.

=============  ======================================================================================================
``drawing``    what a case is made of, drawn from its number and the run's seed; cases on disk
``sight``      how far an undeclared effect stands out, and the noise floor
``judging``    the fit's side: machine file and recordings in, answers out
``scoring``    answers beside what is true; rates and targets
``timing``     how long an identification takes
``closing``    paths followed through identified inverses
=============  ======================================================================================================
"""
