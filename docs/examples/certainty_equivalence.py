# %% [markdown]
# # When is certainty equivalence enough?
#
# The certainty-equivalent policy takes the SOC estimate for the truth; the stochastic one heeds its
# variance. On the HEV of [L] over FTP-72 the first drives the estimate to the edges of the SOC
# window, and the truth over them. What that costs depends on what a second outside the window is
# worth, and on how uncertain the estimate is.

# %%
from drivecycles import load_cycle
from ems import load_concept
from ems.compare import compare
from ems.summary import to_json

hev, cycle = load_concept("hev"), load_cycle("ftp72")


def compare_both(concept):
    """Drive both policies on the same noise."""
    names = ["stochastic", "certainty_equivalent"]
    return compare([concept], cycle, mus=[2e-3], policies=names, realizations=100, seed=0)


def scaled(factor):
    """The HEV with all running penalties multiplied by a factor."""
    prices = ("jump_below_kgps", "slope_below_kgps", "jump_above_kgps", "slope_above_kgps")
    window = hev.window.model_copy(update={name: factor * getattr(hev.window, name) for name in prices})
    return hev.model_copy(update={"window": window})


# %% [markdown]
# Both policies meet the same noise, so the difference is known better than either cost. Steep
# prices first.

# %%
results = {}
for factor in (1.0, 0.1, 0.01):
    comparison = compare_both(scaled(factor))
    pair = to_json(comparison)["paired"][0]
    results[factor] = {case.policy: case for case in comparison.cases}
    low, high = pair["cost_kg"]["ci95"]
    print(f"penalties x {factor:g}: stochastic less certainty-equivalent {pair['cost_kg']['mean']:+.4f} kg")
    print(f"    95 % interval {low:+.4f} to {high:+.4f} kg")
    for name, case in results[factor].items():
        fuel, outside = case.fuel_l_per_100km.mean(), case.rollout.outside_window.mean()
        print(f"    {name:21} {fuel:.3f} l/100 km, {100 * outside:.2f} % of the time outside")

# %% [markdown]
# The fuel that heeding the uncertainty costs is about a per cent, whatever the price. What is saved
# is penalty, in proportion to the price: certainty equivalence is enough where leaving the window
# is cheap, and only there.

# %%
steep = results[1.0]
stochastic, certain = steep["stochastic"], steep["certainty_equivalent"]
more_fuel = stochastic.fuel_l_per_100km.mean() / certain.fuel_l_per_100km.mean() - 1.0
outside = [case.rollout.outside_window.mean() for case in (stochastic, certain)]
print(
    f"{100 * more_fuel:.2f} % more fuel; outside {100 * outside[0]:.2f} % instead of {100 * outside[1]:.2f} %"
)

# %%
assert 0.0 < more_fuel < 0.03, "staying inside costs less than 3 % of fuel"
assert outside[0] < 0.003 < 0.01 < outside[1], "the stochastic policy stays inside, the other one does not"
