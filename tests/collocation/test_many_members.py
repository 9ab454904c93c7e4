"""Many members at once against each of them alone: the same equations, the same steps, the same error estimates."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casahunt import Servo, find_orbit
from casahunt.collocation.error_estimate import functional_errors, on_halves
from casahunt.collocation.mesh import on_halved_mesh
from casahunt.collocation.transcription import settings_of
from casahunt.orbits import find_cycle
from casahunt.orbits.orbit import unknowns_of
from problems import bouncing_ball

B = 7
PARTS = (
    "interval_residual", "flow_residual", "closure_residual", "events", "maps", "closure", "eliminated",
)  # fmt: skip
RATIO = 1e-11
"""Rounding, times what elimination in another order makes of it: condition numbers of intervals are below 1e4."""


def ball():
    _, state = bouncing_ball.truth(0.0125, 1, +1)
    return find_cycle(bouncing_ball.SYSTEM, settled=True, start=state)


ORBITS = {
    "switch": lambda: find_orbit(Servo(), "switch", 0.4),
    "lugre": lambda: find_orbit(Servo(), "lugre", 0.4),
    "ball": ball,  # closed forms and jumps, no collocated phase
}


@pytest.fixture(scope="module", params=ORBITS)
def members(request):
    """A transcription, and disturbed solutions at disturbed parameters."""
    orbit = ORBITS[request.param]()
    t, u, setting = unknowns_of(orbit)
    random = np.random.default_rng(3)
    setting = replace(setting, dp=setting.p * random.uniform(-1, 1, setting.p.size))
    p = setting.p * (1 + 1e-3 * random.uniform(-1, 1, (B, setting.p.size)))
    many = u * (1 + 1e-5 * random.uniform(-1, 1, (B, u.size)))
    settings = settings_of(setting, p, np.repeat(setting.dp[None], B, axis=0))
    fractions = settings.fractions * (1 + 0.01 * random.uniform(-1, 1, settings.fractions.shape))
    return t, many, replace(settings, fractions=fractions)


def off(found, known):
    return np.abs(found - known).max(initial=0.0) / max(1.0, np.abs(known).max(initial=0.0))


def test_linearised_as_alone(members):
    t, u, settings = members
    lin = t.linearise(u, settings)
    border = t.system.border(parameter=1.0)
    du, _, _ = lin.step(np.repeat(border[None], B, axis=0))
    for b in range(B):
        alone = t.linearise(u[b], settings.of(b))
        for part in PARTS:
            assert off(getattr(lin, part)[b], getattr(alone, part)) < RATIO, part
        assert lin.residual_norm()[b] == pytest.approx(alone.residual_norm(), rel=1e-6)
        assert off(du[b], alone.step(border)[0]) < RATIO
    assert lin.finite().all()


def test_a_parameter_that_is_held_stays_where_it_is(members):
    """To the last bit, by rows of any size: what rounding leaves of a zero would be a parameter that has moved."""
    t, u, settings = members
    lin, sizes = t.linearise(u, settings), np.random.default_rng(4).uniform(0.1, 9, B)
    held = np.array([t.system.border(parameter=size) for size in sizes])
    assert (lin.step(held)[2] == 0).all()
    alone = t.linearise(u[0], settings.of(0))
    assert alone.step(held[0])[2] == 0
    assert alone.step(held[0], 2.0)[2] == alone.tangent(held[0])[1][-1] * 2 == 2 / sizes[0]
    free = t.system.border(nodes=np.ones((t.phases + 1, t.n)), parameter=1.0)
    assert alone.step(free)[2] != 0


def test_several_directions(members):
    """The columns of a direction in parameter space are those of a setting with that dp."""
    t, u, settings = members
    random = np.random.default_rng(5)
    directions = settings.p[:, None] * random.uniform(-1, 1, (B, 3, settings.p.shape[1]))
    lin = t.linearise(u, replace(settings, dp=directions[:, 0], others=directions[:, 1:]))
    for k in range(3):
        alone = t.linearise(u[2], replace(settings.of(2), dp=directions[2, k]))
        assert off(lin.maps[2][..., t.n + 2 + k], alone.maps[..., t.n + 2]) < RATIO
        assert off(lin.events[2, t.n + 2 + k], alone.events[t.n + 2]) < RATIO


def test_errors_as_alone(members):
    t, u, settings = members
    goals = np.zeros((B, 2, t.system.size))
    goals[:, 0, -1 - t.phases : -1] = 1.0
    goals[:, 1, 0] = 1.0
    border = t.system.border(parameter=1.0)
    borders = np.repeat(border[None], B, axis=0)
    errors, shares, _ = functional_errors(t, u, settings, goals, border=borders)
    fine, finer, halves, _ = halved = on_halves(t, u, settings)
    again, _, _ = functional_errors(t, u, settings, goals, halved=halved)
    assert again == pytest.approx(errors)
    for b in range(B):
        alone, x, fractions = on_halved_mesh(t, u[b], settings.fractions[b])
        assert alone == fine and off(finer[b], x) < RATIO and off(halves.fractions[b], fractions) < RATIO
        known, parts, _ = functional_errors(t, u[b], settings.of(b), goals[b])
        assert errors[b] == pytest.approx(known, rel=1e-5)
        np.testing.assert_allclose(shares[b], parts, rtol=1e-5, atol=1e-5 * known.max())


def test_a_member_knows_nothing_of_the_others(members):
    """To the last bit: alone, in another order, beside one that is nowhere."""
    t, u, settings = members
    border = np.repeat(t.system.border(parameter=1.0)[None], B, axis=0)
    goals = np.zeros((B, 1, t.system.size))
    goals[:, 0, 0] = 1.0

    def numbers(which, spoilt=None):
        x = u[which].copy()
        if spoilt is not None:
            x[spoilt] = np.nan
        own = settings.of(np.array(which))
        lin = t.linearise(x, own)
        errors, _, better = functional_errors(t, x, own, goals[which])
        better = [] if better is None else [better[1]]
        return np.concatenate([lin.step(border[: len(x)])[0], errors, *better], axis=1)

    together = numbers(list(range(B)))
    assert np.array_equal(numbers([4])[0], together[4])
    assert np.array_equal(numbers([5, 0, 4])[2], together[4])
    beside = numbers(list(range(B)), spoilt=3)
    assert np.array_equal(np.delete(beside, 3, axis=0), np.delete(together, 3, axis=0))
    assert not np.isfinite(beside[3]).any()


def test_a_singular_member_is_its_own(members, monkeypatch):
    """numpy refuses a whole stack where one matrix is singular."""
    t, u, settings = members
    if not t.intervals:
        pytest.skip("no interval to eliminate")
    honest, seen = np.linalg.solve, []

    def refuses(matrices, known):
        seen.extend([] if seen else matrices[:: t.intervals])  # the first interval of every member
        if any(np.array_equal(one, seen[1]) for one in matrices):
            raise np.linalg.LinAlgError
        return honest(matrices, known)

    whole = t.linearise(u, settings)
    monkeypatch.setattr(np.linalg, "solve", refuses)
    lin = t.linearise(u, settings)
    assert lin.finite().tolist() == [b != 1 for b in range(B)]
    assert np.array_equal(lin.maps[2], whole.maps[2])
