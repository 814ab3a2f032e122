"""Long work as durable jobs; what the kinds of jobs are stands in the folders of what they make.

- :mod:`server.jobs.job_kinds`: what a kind of job has to tell the runner
- :mod:`server.jobs.job_runner`: the engine: queues them, and runs them as workflows of stages, each recorded once done
- :mod:`server.jobs.execution`: one execution of a job on one host, from its claim to its end
- :mod:`server.jobs.job_host`: what the executions of one process share
- :mod:`server.jobs.job_places`: where their stages write, and where their files are once they are over
- :mod:`server.jobs.claims`, :mod:`server.jobs.executors`: who works on what, and who fell silent
"""
