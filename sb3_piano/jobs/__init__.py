"""Jobs: work in folders, which may stop at any moment and resume, on this machine or a cluster.

An executor runs them, a :class:`concurrent.futures.Executor` of local processes or of Ray, so that
callers need not know where a job runs.
"""

from sb3_piano.jobs.cluster import Resources, connected_to_ray, ray_executor
from sb3_piano.jobs.finish import finish
from sb3_piano.jobs.folders import begin_or_go_on, check_same, is_empty
from sb3_piano.jobs.job import Job, Outcome, status
from sb3_piano.jobs.mapping import Item, Result, map_jobs
from sb3_piano.jobs.pool import Here, WorkerDied, open_executor, process_pool

__all__ = [
    "Here",
    "Item",
    "Job",
    "Outcome",
    "Resources",
    "Result",
    "WorkerDied",
    "begin_or_go_on",
    "check_same",
    "connected_to_ray",
    "finish",
    "is_empty",
    "map_jobs",
    "open_executor",
    "process_pool",
    "ray_executor",
    "status",
]
