"""The store: one SQLite file, or a PostgreSQL database that several hosts share.

- :mod:`server.platform.database.engine`: connections, transactions, revision counters, pages
- :mod:`server.platform.database.schema`: what all tables share; those of a resource stand in its folder
- :mod:`server.platform.database.migrations`: brings an older store up to date
- :mod:`server.platform.database.database_copies`: copies of the whole database
- :mod:`server.platform.database.idempotency`: requests that came before make nothing a second time
- :mod:`server.platform.database.patience`: waits for a database that is away
"""
