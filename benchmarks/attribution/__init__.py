"""How often the residual loop is right, on machines, effects and sizes that it has never seen.

=================  ==================================================================================================
``recipe``         what a case is made of, drawn from its class, number and seed
``sight``          lambda: how far the true effect stands out of the noise, after the base model took its part
``making``         recordings of a case, with the effect's size scaled to the lambda that was drawn
``case_files``     cases on disk, as the files that ``hilfit identify`` reads
``judging``        the fit's side: machine file and recordings in, what it says out
``apart``          which other names the data cannot tell from the true one
``verdicts``       what was said, and intervals of parameters, beside what is true
``summary``        confusion table, rates with intervals, targets
``runs``           many cases in processes of their own, appended line by line; comparison of two runs
=================  ==================================================================================================
"""
