"""The store: machines, recordings, identifications and jobs in one SQLite file.

- :mod:`server.store.tables`: the tables
- :mod:`server.store.database`: connections, transactions, revision counters, pages
- :mod:`server.store.machines`, :mod:`~server.store.recordings`, :mod:`~server.store.identifications`,
  :mod:`~server.store.jobs`: one repository each; rows go in and come out as frozen dataclasses
"""

from server.store.database import Database, Page
from server.store.identifications import Identification, Identifications
from server.store.jobs import Job, JobEvent, Jobs
from server.store.machines import MachineRow, Machines
from server.store.recordings import RecordingRow, Recordings

__all__ = [
    "Database",
    "Identification",
    "Identifications",
    "Job",
    "JobEvent",
    "Jobs",
    "MachineRow",
    "Machines",
    "Page",
    "RecordingRow",
    "Recordings",
]
