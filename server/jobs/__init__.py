"""What jobs there are.

- :mod:`server.jobs.kinds`: what a kind of job has to tell the runner (:mod:`server.workflows`)
- :mod:`server.jobs.places`: where their stages write, and where their files are once they are over
- :mod:`server.jobs.identification`: fit recordings
- :mod:`server.jobs.excitation`: design a motion, in a process of its own (:mod:`server.jobs.excitation_child`)
- :mod:`server.jobs.recalibration`: record, fit, compare with the active calibration, propose
- :mod:`server.jobs.comparison`: the before/after table of a recalibration; pure functions
"""
