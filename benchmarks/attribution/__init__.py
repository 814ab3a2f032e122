"""Rate at which the residual loop is right, on machines, effects and sizes that it has never seen.

=================  ==================================================================================================
``recipe``         what a case is made of, drawn from its class, number and seed
``sight``          lambda: how large the true effect is in the noise, after the base model took its part
``making``         recordings of a case, with the effect's size scaled to the lambda that was drawn; cases on disk
``judging``        the fit's side: machine file and recordings in, its findings out
``apart``          which other names the data cannot separate from the true one
``verdicts``       findings, and intervals of parameters, beside what is true
``summary``        confusion table, rates with intervals, targets, reliability; comparison of two runs
``runs``           a case from its key to a line of results, and all cases of a run
=================  ==================================================================================================
"""
