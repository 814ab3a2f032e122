"""Signals over time, as a plot needs them: the smallest and largest value of each of a bounded number of moments.

- :mod:`server.traces.signal_collector`: reads the rings of all machines that are acquired into their memories: the
  last eight hours at three resolutions
- :mod:`server.traces.recorded_signals`: the same of a recording, its spectrum, its events, what the checks find
- :mod:`server.traces.recording_child`: makes their columns readable; a part of a recording as a recording of its own
"""
