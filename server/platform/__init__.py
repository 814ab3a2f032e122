"""The base of all resources; it knows none of them.

- :mod:`server.platform.resource`, :mod:`server.platform.service`: what a resource declares, the parts that it provides,
  and the service that is composed of such declarations
- :mod:`server.platform.authorization`: who may do what
- :mod:`server.platform.database`: the store's connections, transactions, migrations and copies
- :mod:`server.platform.http`: problem documents, limits, kept answers, the page's files
- :mod:`server.platform.processes`: child processes, and work that is kept apart from the threads that answer reads
- :mod:`server.platform.settings`, :mod:`server.platform.files`, :mod:`server.platform.tls`,
  :mod:`server.platform.logs`, :mod:`server.platform.errors`: configuration, data directory, certificate, logs, errors
"""
