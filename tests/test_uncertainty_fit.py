"""[L]'s model fitted to data of its own making gives it back, and says where data are not of its making."""

import dataclasses

import numpy as np
import pytest
from ems_cases import full_problem

from bms import BatteryError, UncertaintyModel
from bms import _uncertainty_fit as kernel
from bms.uncertainty import gain as gain_of
from bms.uncertainty import next_variance
from bms.uncertainty_fit import Behaviour, _Search, assess, fit_uncertainty, model_variance
from ems import GridSettings, build_policy, build_problem, draw_noise, roll_out

TRUTH = UncertaintyModel(gamma=4e-7, beta=2e-7, mu=3e-3)
NAMES = ("gamma", "beta", "mu")


@pytest.fixture(scope="module", params=["hev", "phev"])
def made(request):
    """What [L]'s own estimator does on its own plant, and the pack; the rules drive."""
    whole = full_problem(request.param)
    # A drive of its own, whatever the default grid: its currents decide how well gamma and beta come apart.
    drive = build_problem(whole.concept, whole.cycle, settings=GridSettings(torque_levels=21))
    problem = dataclasses.replace(drive, uncertainty=TRUTH)
    rollout = roll_out(problem, build_policy("rule_based", problem), draw_noise(0, 20, problem.steps))
    estimate = rollout.soc_estimate.astype(float)
    return (
        Behaviour(
            1.0,
            estimate,
            rollout.soc - estimate,
            rollout.variance.astype(float),
            rollout.current_A.astype(float),
        ),
        problem.pack,
    )


@pytest.mark.parametrize("weight", [0.0, 0.5, 1.0])
def test_the_postulated_model_is_found_again(made, weight):
    found = fit_uncertainty(*made, error_weight=weight)
    for name in NAMES:
        off = getattr(found.model, name) - getattr(TRUTH, name)
        assert abs(off) < 3.0 * getattr(found.standard_errors, name) + 1e-3 * getattr(TRUTH, name)
        assert abs(off) < 0.4 * getattr(TRUTH, name)
    fit = found.fit
    assert fit.explained_believed > 0.9 and fit.off_believed < 0.05
    # A table of single precision, errors in antithetic pairs, and a filter that takes alpha at its belief.
    for name in ("nees_estimator", "nees_model", "step_ratio", "minute_ratio", "moved_ratio"):
        assert getattr(fit, name) == pytest.approx(1.0, abs=0.15)
    assert fit.inside_model == pytest.approx(0.954, abs=0.01)
    assert abs(fit.correlation - fit.correlation_model) < 0.06


def test_the_recursion_is_that_of_the_module(made):
    behaviour, pack = made
    path, gain, noise = model_variance(behaviour, pack, TRUTH)
    assert np.allclose(path, behaviour.variance, rtol=2e-5)
    drift = TRUTH.process_variance(behaviour.current_A, 1.0)
    assert np.allclose(path[:, 1:], next_variance(path[:, :-1], noise, drift), rtol=1e-12)
    assert np.allclose(gain, gain_of(path[:, :-1], noise), rtol=1e-9)
    at = (slice(0, 2), slice(0, 400, 50))
    exact = TRUTH.measurement_variance(behaviour.soc[:, :-1][at], path[:, :-1][at], pack.ocv.alpha)
    assert np.allclose(noise[at], exact, rtol=2e-3)


@pytest.mark.parametrize("weight", [0.0, 0.7])
def test_kernel_equals_a_plain_twin_and_its_slopes_are_those_of_its_loss(made, weight):
    behaviour, pack = made
    short = Behaviour(
        2.0,
        *(values[:3, :301].copy() for values in (behaviour.soc, behaviour.error, behaviour.variance)),
        behaviour.current_A[:3, :300].copy(),
    )
    search, theta = _Search(short, pack, weight), np.array([3e-7, 1e-7, 5e-3])
    loss, slope, curvature = search.score(theta)
    assert np.allclose(loss, naive_loss(short, pack, weight, theta), rtol=1e-9)
    for i in range(3):
        nudge = np.zeros(3)
        nudge[i] = 1e-5
        above, below = (search.score(theta * np.exp(sign * nudge))[0] for sign in (1.0, -1.0))
        assert np.allclose(slope[:, i], (above - below) / 2e-5, rtol=2e-3, atol=1e-3)
    assert np.allclose(curvature, np.swapaxes(curvature, 1, 2))
    assert np.all(np.linalg.eigvalsh(curvature) > 0.0)


def naive_loss(behaviour, pack, weight, theta):
    """The quasi-likelihood of the docstring, in numpy."""
    model = UncertaintyModel(**dict(zip(NAMES, theta, strict=True)))
    path, gain, _ = model_variance(behaviour, pack, model)
    level = weight * behaviour.error**2 + (1.0 - weight) * behaviour.variance
    loss = np.sum(np.log(path[:, 1:]) + level[:, 1:] / path[:, 1:], axis=1)
    lag = 150
    windows = behaviour.soc.shape[1] - lag
    for k in range(windows):
        part = slice(k, k + lag)
        learnt = np.sum(gain[:, part] * path[:, part], axis=1)
        charge = np.sum(behaviour.current_A[:, part], axis=1) * 2.0 / pack.capacity_C
        moved = behaviour.soc[:, k + lag] - behaviour.soc[:, k] - charge
        loss += (np.log(learnt) + moved**2 / learnt) / lag
    return loss


@pytest.mark.parametrize("made", ["hev"], indirect=True)
def test_standard_errors_are_those_of_fits_to_resampled_realizations(made):
    """The bootstrap's single Gauss-Newton step against whole fits."""
    behaviour, pack = made
    found = fit_uncertainty(behaviour, pack, error_weight=1.0)
    rng, fits = np.random.default_rng(5), []
    for _ in range(10):
        picks = rng.integers(20, size=20)
        drawn = Behaviour(
            1.0, *(getattr(behaviour, name)[picks] for name in ("soc", "error", "variance", "current_A"))
        )
        fits.append(fit_uncertainty(drawn, pack, error_weight=1.0, resamples=2).model)
    for name in ("beta", "mu"):
        spread = np.std([getattr(fit, name) for fit in fits], ddof=1)
        assert getattr(found.standard_errors, name) == pytest.approx(spread, rel=0.7)


def test_an_offset_that_stays_is_not_white(made):
    """What [L] does not know: errors that last the trip, of an estimator that learns nothing."""
    behaviour, pack = made
    rng = np.random.default_rng(2)
    charge = np.cumsum(behaviour.current_A, axis=1) / pack.capacity_C
    soc = np.clip(behaviour.soc[:, :1] + np.concatenate([np.zeros((20, 1)), charge], axis=1), 0.0, 1.0)
    error = 0.01 * rng.standard_normal((20, 1)) * np.linspace(1.0, 2.0, soc.shape[1])
    lasting = Behaviour(1.0, soc, error, np.full(soc.shape, 1e-4), behaviour.current_A)
    found = fit_uncertainty(lasting, pack, error_weight=0.0)
    assert found.model.mu == pytest.approx(100.0, rel=0.05) or found.model.mu > 1.0
    assert any("mu is at its upper bound" in note for note in found.notes)
    fit = assess(lasting, pack, TRUTH)
    assert fit.correlation > 0.99 and fit.correlation_model < 0.01
    assert fit.minute_ratio > 10.0
    assert fit.nees_estimator == pytest.approx(np.mean(error**2) / 1e-4)


def test_what_cannot_be_fitted_is_refused(made):
    behaviour, pack = made
    arrays = {name: getattr(behaviour, name) for name in ("soc", "error", "variance", "current_A")}
    with pytest.raises(BatteryError, match="share between 0 and 1"):
        fit_uncertainty(behaviour, pack, error_weight=1.5)
    with pytest.raises(BatteryError, match="no standard error"):
        fit_uncertainty(behaviour, pack, resamples=1)
    with pytest.raises(BatteryError, match="error has the shape"):
        Behaviour(1.0, **(arrays | {"error": arrays["error"][:, :-1]}))
    with pytest.raises(BatteryError, match="NaN"):
        Behaviour(1.0, **(arrays | {"error": arrays["error"] * np.nan}))
    with pytest.raises(BatteryError, match="too few"):
        Behaviour(1.0, **{name: values[:1] for name, values in arrays.items()})
    assert kernel.LEAST_VARIANCE > 0.0
