"""Client of a hilfit service; it needs nothing but Python.

- :mod:`hilfit_client.client`: :class:`Client`
- :mod:`hilfit_client.generated`: one class per resource, one TypedDict per schema, made from ``docs/openapi.json``
- :mod:`hilfit_client.transport`: requests, and :class:`ProblemError`
"""

from hilfit_client.client import Client
from hilfit_client.transport import ProblemError

__all__ = ["Client", "ProblemError"]
