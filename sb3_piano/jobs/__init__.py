"""Executors: what does independent jobs, on this machine or on a cluster of Ray.

All are of the kind of :class:`concurrent.futures.Executor`, so that who has jobs to do need not
know where they are done.
"""

from sb3_piano.jobs.cluster import Resources, connected_to_ray, ray_executor
from sb3_piano.jobs.mapping import Item, Result, map_jobs
from sb3_piano.jobs.opening import open_executor
from sb3_piano.jobs.pool import broken_told, process_pool

__all__ = [
    "Item",
    "Resources",
    "Result",
    "broken_told",
    "connected_to_ray",
    "map_jobs",
    "open_executor",
    "process_pool",
    "ray_executor",
]
