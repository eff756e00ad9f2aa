"""The mission of many worlds as Taichi functions: tasks, boat strategies, target rules, fixes, rewards, observations.

`run.run` is the kernel, `worlds.Worlds` has the arrays that its functions pass on. Shipped tasks are imported here.
"""

from usvauv.kernels.mission.tasks import data_collection, station_keeping  # noqa: F401 - they register themselves
