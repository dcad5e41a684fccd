"""Drive cycles: load by name or from a CSV file, join, repeat, resample, lay on an altitude profile."""

from drivecycles.cycle import DriveCycle, join
from drivecycles.errors import CycleError
from drivecycles.io import read_csv
from drivecycles.library import CycleInfo, cycle_info, cycle_names, load_cycle
from drivecycles.statistics import CycleStatistics

__all__ = [
    "CycleError",
    "CycleInfo",
    "CycleStatistics",
    "DriveCycle",
    "cycle_info",
    "cycle_names",
    "join",
    "load_cycle",
    "read_csv",
]
