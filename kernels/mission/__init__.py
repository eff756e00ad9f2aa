"""The mission of many worlds as Taichi functions: tasks, boat strategies, target rules, fixes, rewards, observations.

`run.run` is the kernel, `worlds.Worlds` the arrays that its functions pass on. A shipped task is imported here.
"""

from usvauv.kernels.mission.tasks import data_collection, station_keeping  # noqa: F401 - they register themselves
