"""Recordings in the forms that other tools read (:mod:`daq.formats`) over HTTP; and their statistics.

Everything that opens a file from outside runs in a child process with bounded memory
(:mod:`server.recordings.formats.conversion_child`).

- :mod:`server.recordings.formats.conversion_child`: what a recording holds, channel by channel
- :mod:`server.recordings.formats.imports`: what service and child agree upon when another tool's file is taken in
- :mod:`server.recordings.formats.exports`: the service's side: starts the children, names the files

Nothing is imported here: the children load what their piece of work needs, and not the store.
"""
