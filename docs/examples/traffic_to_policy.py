# %% [markdown]
# # From uncertain traffic to a policy
#
# A policy is optimised for a trip, and the traffic makes another one of it. Here the free-flow
# speed, the critical and the jam density of a road with an incident are uncertain; each draw gives
# a speed field, a probe vehicle drives through it, and the policies that were computed for the mean
# trip drive all of them.

# %%
import numpy as np

from drivecycles.traffic.ensemble import draw_cycles
from drivecycles.traffic.scenario_file import load_scenario
from ems import load_concept
from ems.ensemble import compare_ensemble
from ems.ensemble_summary import by_member

scenario = load_scenario("commute")
ensemble = draw_cycles(scenario, cycles=12, seed=1)
durations_s = np.array([cycle.duration_s for cycle in ensemble.members])
print(f"planned: {ensemble.planned.duration_s:.0f} s, {ensemble.planned.distance_m / 1e3:.2f} km")
print(f"driven: {durations_s.min():.0f} to {durations_s.max():.0f} s")

# %% [markdown]
# Which parameter decides how long the drive takes? Three parameters and twelve cycles allow a
# regression, no more.

# %%
standard = (ensemble.values - ensemble.values.mean(axis=0)) / ensemble.values.std(axis=0)
slopes_s, *_ = np.linalg.lstsq(standard, durations_s - durations_s.mean(), rcond=None)
for name, slope_s in zip(ensemble.names, slopes_s, strict=True):
    print(f"one standard deviation of {name}: {slope_s:+.1f} s")

# %% [markdown]
# The policies look up the cost-to-go of the place where the car is, not of the time: a jam does not
# make them think that they are nearly there.

# %%
comparison = compare_ensemble(
    [load_concept("hev")],
    ensemble.planned,
    ensemble.members,
    mus=[2e-3],
    policies=["stochastic", "certainty_equivalent", "rule_based"],
)
costs = {case.policy: by_member(case.rollout.cost_kg) for case in comparison.cases}
for case in comparison.cases:
    print(
        f"{case.policy:21} {costs[case.policy].mean():.3f} kg, fuel {case.rollout.fuel_kg.mean():.3f} kg,"
        f" {100 * case.rollout.outside_window.mean():.2f} % outside"
    )
wins = int(np.sum(costs["stochastic"] < costs["certainty_equivalent"]))
print(f"the stochastic policy costs less on {wins} of {len(ensemble.members)} cycles")

# %%
distance_m = [cycle.distance_m for cycle in ensemble.members]
assert np.ptp(distance_m) < 0.01 * np.mean(distance_m), "every member drives the same road, to 1 %"
assert wins >= 10, "heeding the uncertainty pays on at least ten of the twelve cycles"
assert costs["stochastic"].mean() < costs["rule_based"].mean(), "and beats the rules, by 0 kg and more"
