"""The service of hilfit and its command line.

- :mod:`server.cli`: the ``hilfit`` command; mounts the commands of the other packages
- :mod:`server.serve`: ``hilfit serve``: one process that serves HTTP and starts all others
- :mod:`server.app`, :mod:`server.routes`, :mod:`server.problems`: REST below ``/api/v1``, errors as problem
  documents
- :mod:`server.service`: what runs behind the routes, put together
- :mod:`server.workflows`, :mod:`server.stages`, :mod:`server.children`: identifications as durable jobs in
  child processes
- :mod:`server.acquisition`, :mod:`server.simulation`: acquisition per machine, the simulated machine
- :mod:`server.store`, :mod:`server.files`: database and data directory

Nothing is imported before it is used: the command line has to start fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from server.app import create_app
    from server.settings import Settings

__all__ = ["Settings", "create_app"]


def __getattr__(name: str) -> Any:
    if name == "Settings":
        from server.settings import Settings

        return Settings
    if name == "create_app":
        from server.app import create_app

        return create_app
    raise AttributeError(f"module 'server' has no attribute '{name}'")
