"""Jobs: resumable work in folders, on this machine or on a Ray cluster."""

from sb3_piano.jobs.cluster import Resources
from sb3_piano.jobs.job import Job, Outcome, finish, map_jobs, status
from sb3_piano.jobs.pool import Here, open_executor

__all__ = [
    "Here",
    "Job",
    "Outcome",
    "Resources",
    "finish",
    "map_jobs",
    "open_executor",
    "status",
]
