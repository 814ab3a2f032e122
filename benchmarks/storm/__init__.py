"""A storm of kill -9 on a running service, with faults of disk, store and clock; and what has to be whole afterwards.

- :mod:`benchmarks.storm.run`: the storm
- :mod:`~benchmarks.storm.processes`: hosts and their children, found and killed by process id; which is next, and when
- :mod:`~benchmarks.storm.host`, :mod:`~benchmarks.storm.stages`, :mod:`~benchmarks.storm.real_stages`: what is killed
- :mod:`~benchmarks.storm.faults`, :mod:`~benchmarks.storm.clock`: what else goes wrong
- :mod:`~benchmarks.storm.traffic`: clients, before, during and after it, that note what was acknowledged
- :mod:`~benchmarks.storm.checks`: what has to be so"""
