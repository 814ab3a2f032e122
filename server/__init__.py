"""The service of hilfit and its command line.

- :mod:`server.commands`: the ``hilfit`` command, which mounts the commands of the other packages
- :mod:`server.composition`: the service put together of its resources, and the processes that run it
- one folder per resource (:mod:`server.machines`, :mod:`server.recordings`, ...), each with its declaration
  and routes ``*_resource.py``, what they take and give beside them or in ``*_schemas.py``, what it stores
  ``*_store.py`` and its jobs ``*_job.py``
- :mod:`server.platform`: what all resources stand on

Nothing is imported before it is used: the command line has to start fast.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from server.composition.app import create_app
    from server.platform.settings import Settings

__all__ = ["Settings", "create_app"]


def __getattr__(name: str) -> Any:
    if name == "Settings":
        from server.platform.settings import Settings

        return Settings
    if name == "create_app":
        from server.composition.app import create_app

        return create_app
    raise AttributeError(f"module 'server' has no attribute '{name}'")
