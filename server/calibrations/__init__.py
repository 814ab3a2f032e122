"""Calibrations: identifications that a person approved. One is active per machine; the old ones stay.

- :mod:`server.calibrations.calibration_content`: what a calibration takes from a report
- :mod:`server.calibrations.calibration_store`: states and who brought them about
- :mod:`server.calibrations.calibration_resource`: routes; two of them side by side
- :mod:`server.calibrations.calibration_desk`: all of it behind one object,
  :class:`~server.calibrations.calibration_desk.Calibrations`
"""
