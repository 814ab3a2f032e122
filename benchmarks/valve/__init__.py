"""Identification of valves against the truth, on plants, effects and motions that are drawn at random.

=============  ======================================================================================================
``drawing``    what a case is made of, how visible its effect is, the noise floor; cases on disk
``judging``    the fit's side: machine file and recordings in, answers out
``scoring``    answers beside what is true, paths followed through inverses; rates and targets
``runs``       all cases of a run; how long an identification takes
``watching``   the monitor on healthy and on changed machines
=============  ======================================================================================================"""
