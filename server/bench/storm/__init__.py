"""A storm of kill -9 on a running service, and what has to be whole afterwards.

- :mod:`server.bench.storm.run`: the storm
- :mod:`~server.bench.storm.processes`: hosts and their children, found and killed by process id
- :mod:`~server.bench.storm.host`, :mod:`~server.bench.storm.stages`: what is killed
- :mod:`~server.bench.storm.traffic`: clients that note what they were told
- :mod:`~server.bench.storm.checks`: what has to be so
"""
