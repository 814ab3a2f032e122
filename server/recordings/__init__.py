"""Recordings: made here from a running acquisition, or uploaded; sealed files that never change.

- :mod:`server.recordings.recording_sessions`: recordings in progress
- :mod:`server.recordings.recording_uploads`: files that clients send, looked at in a process of their own
  (:mod:`server.recordings.inspect_recording`)
- :mod:`server.recordings.formats`: the forms that other tools read, and statistics
- :mod:`server.recordings.shared_recordings`: where workers without the data directory find them
"""
