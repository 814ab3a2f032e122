"""Identifications of valves: edges, speeds and delays from recordings with commands, and inverses for a controller.

Orders, jobs, store and files are those of :mod:`server.identifications`. Nothing here opens a bus, nor does anything
that it starts: recordings are read, files are written.
"""
