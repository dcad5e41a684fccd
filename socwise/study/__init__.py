"""Studies: many comparisons as data, computed by many processes, in a folder that survives.

``load_study`` reads a study file, ``run_study`` computes what is missing, ``read_study`` reads what there is.
"""

from socwise.study.errors import StudyError
from socwise.study.loading import LoadedStudy, load_study
from socwise.study.plan import Plan, make_plan
from socwise.study.reading import StoredStudy, StudyCase, read_study
from socwise.study.running import StudyRun, run_study

__all__ = [
    "LoadedStudy",
    "Plan",
    "StoredStudy",
    "StudyCase",
    "StudyError",
    "StudyRun",
    "load_study",
    "make_plan",
    "read_study",
    "run_study",
]
