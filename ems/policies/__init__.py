"""Energy-management policies by name, one file each."""

from __future__ import annotations

import difflib
from types import ModuleType

from ems._choose import CERTAIN, ESTIMATE, TRUTH, Action
from ems.errors import EmsError
from ems.policies import certainty_equivalent, perfect_information, rule_based, stochastic
from ems.policies.base import CostToGoPolicy, Policy
from ems.policies.kind import PolicyKind
from ems.policies.rule_based import RuleBasedPolicy
from ems.problem import Problem

AnyPolicy = CostToGoPolicy | RuleBasedPolicy

_MODULES: dict[str, ModuleType] = {
    module.NAME: module for module in (stochastic, certainty_equivalent, perfect_information, rule_based)
}


def policy_names() -> tuple[str, ...]:
    """Names of the policies, in the order of the tables."""
    return tuple(_MODULES)


def find_policy(name: str) -> ModuleType:
    """Find the module of a policy; ``build`` solves a problem, ``DEPENDS_ON_MU`` says if mu matters.

    Raises
    ------
    EmsError
        Unknown name, with the nearest known one.
    """
    wanted = name.strip().lower().replace("-", "_")
    if wanted not in _MODULES:
        near = difflib.get_close_matches(wanted, _MODULES, n=1, cutoff=0.3)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise EmsError(f"no policy is called {name!r}; known are {', '.join(_MODULES)}{hint}")
    return _MODULES[wanted]


def policy_kind(policy: str | PolicyKind) -> PolicyKind:
    """Give a policy that was named, or is the user's own, with the way to build it.

    Raises
    ------
    EmsError
        Unknown name, or a policy of the user's own with a name of ours.
    """
    if isinstance(policy, PolicyKind):
        if policy.name in _MODULES:
            raise EmsError(f"{policy.name!r} is the name of a policy of socwise; call yours otherwise")
        return policy
    module = find_policy(policy)
    return PolicyKind(module.NAME, module.build, module.DEPENDS_ON_MU)


def acts_on_truth(policy: Policy) -> bool:
    """Whether a policy wants to be told the true SOC instead of a belief."""
    return getattr(policy, "acts_on", ESTIMATE) == TRUTH


def build_policy(name: str, problem: Problem) -> AnyPolicy:
    """Solve a problem with the policy of a name."""
    policy: AnyPolicy = find_policy(name).build(problem)
    return policy


__all__ = [
    "CERTAIN",
    "ESTIMATE",
    "TRUTH",
    "Action",
    "AnyPolicy",
    "CostToGoPolicy",
    "Policy",
    "PolicyKind",
    "RuleBasedPolicy",
    "acts_on_truth",
    "build_policy",
    "find_policy",
    "policy_kind",
    "policy_names",
]
