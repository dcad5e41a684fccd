"""What to do about a state of charge that is only estimated: policies, and what they are worth."""

from ems import _kernels as _kernels
from ems.concept import Concept, concept_names, load_concept
from ems.errors import EmsError, GridWarning
from ems.grid import GridSettings
from ems.noise import Noise, draw_noise
from ems.policies import build_policy, policy_names
from ems.problem import Problem, build_problem
from ems.records import Case, Comparison, Rollout
from ems.simulate import roll_out

__all__ = [
    "Case",
    "Comparison",
    "Concept",
    "EmsError",
    "GridSettings",
    "GridWarning",
    "Noise",
    "Problem",
    "Rollout",
    "build_policy",
    "build_problem",
    "concept_names",
    "draw_noise",
    "load_concept",
    "policy_names",
    "roll_out",
]
