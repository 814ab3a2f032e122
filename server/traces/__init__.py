"""Signals over time, as a plot needs them: the smallest and largest value of each of a bounded number of moments.

- :mod:`server.traces.signal_memory`: the last eight hours of a machine, in memory, at three resolutions
- :mod:`server.traces.signal_collector`: reads the rings of all machines that are acquired into those memories
- :mod:`server.traces.recorded_signals`: the same of a recording, its spectrum, its events, what the checks find
- :mod:`server.traces.recording_cuts`: a part of a recording as a recording of its own
"""
