"""The compiled sweep along a chain of matrices, against numpy's factorisations."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt.orbits.graded import FACTORS_AT_ONCE, LARGEST_COMPILED, MANY_AT_ONCE, carried_backwards, swept


@pytest.mark.parametrize("n", [1, 2, 3, 4, LARGEST_COMPILED, LARGEST_COMPILED + 1])
@pytest.mark.parametrize("count", [1, 3, FACTORS_AT_ONCE, FACTORS_AT_ONCE + 1, MANY_AT_ONCE])
def test_a_sweep_is_numpys(n: int, count: int) -> None:
    rng = np.random.default_rng(n)
    factors = rng.standard_normal((count, n, n)) * 10.0 ** rng.uniform(-1, 1, (count, n, 1))
    q = np.linalg.qr(rng.standard_normal((n, n)))[0]
    after, steps, product = swept(factors, q, np.eye(n))
    frame, whole = q, np.eye(n)
    for factor, step in zip(factors, steps, strict=True):
        fresh, r = np.linalg.qr(factor @ frame)
        signs = np.sign(np.diag(r)) * np.sign(np.diag(step))
        assert np.allclose(step, np.diag(signs) @ r, rtol=1e-8, atol=1e-11 * np.abs(r).max())
        assert np.array_equal(step, np.triu(step))
        frame, whole = fresh * signs, step @ whole
    assert np.allclose(after, frame, atol=1e-9)
    assert np.allclose(after.T @ after, np.eye(n), atol=1e-14)
    assert np.allclose(product, whole, rtol=1e-12, atol=1e-13 * np.abs(whole).max())


@pytest.mark.parametrize("size", [0.0, 5e-324, 1e-200, 1e200])
def test_entries_of_any_size(size: float) -> None:
    q, steps, _ = swept(size * np.array([[[1.0, 2.0], [3.0, 5.0]]]), np.eye(2), np.eye(2))
    assert np.allclose(q.T @ q, np.eye(2), atol=1e-12)
    assert np.allclose(q @ steps[0], size * np.array([[1.0, 2.0], [3.0, 5.0]]), rtol=1e-12, atol=5e-323)


@pytest.mark.parametrize("n", [1, 2, 4, LARGEST_COMPILED + 1])
@pytest.mark.parametrize("count", [1, FACTORS_AT_ONCE, FACTORS_AT_ONCE + 1, MANY_AT_ONCE + 1, 3 * MANY_AT_ONCE])
def test_a_row_carried_backwards(n: int, count: int) -> None:
    rng = np.random.default_rng(n)
    steps, z = np.triu(rng.standard_normal((count, n, n))), rng.standard_normal(n)
    found = carried_backwards(steps, z)
    for k in range(count - 1, -1, -1):
        assert np.allclose(found[k] / np.linalg.norm(found[k]), z / np.linalg.norm(z), rtol=1e-9, atol=1e-12)
        z = z @ steps[k]
        z /= np.linalg.norm(z)


def test_a_row_that_ends() -> None:
    """A factor that nothing comes through: zero before it, and no division by that."""
    steps = np.array([np.eye(2), np.zeros((2, 2)), np.eye(2)])
    assert np.array_equal(carried_backwards(steps, np.array([1.0, 2.0])), [[0, 0], [0.5, 1], [1, 2]])
