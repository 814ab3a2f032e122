"""Recordings: made here from a running acquisition, or uploaded; sealed files that never change.

- :mod:`server.recordings.recording_sessions`: recordings in progress
- :mod:`server.recordings.recording_uploads`: files that clients send, looked at in a process of their own
  (:mod:`server.recordings.inspect_recording`)
- :mod:`server.recordings.formats`: the forms that other tools read, and statistics
"""
