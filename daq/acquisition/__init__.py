"""Acquiring: the process with its cycles, the ring buffer, the recorder and its journal, traces and their replay."""
