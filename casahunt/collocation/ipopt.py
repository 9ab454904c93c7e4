"""IPOPT, the only solver that CasADi runs: for a root, for the largest parameter, for a small cost.

For a root of the square system of newton.py IPOPT gets f = 0, the equations and the border row as constraints, `jac_g`
placed by permutation and an empty `hess_lag`, which is legitimate: the problem is square, so the multipliers are zero.
IPOPT's own "success" is not an answer: a little past a fold residuals are as small as it asks for, though there is no
root.  Its point is judged by the step that Newton's method would still make there.

Which solver solves: Newton (newton.py) or IPOPT, alone or one after the other.

A root of the equations, under a border row or at a fixed lambda; or the extremum of lambda (newton.py).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import casadi as ca
import numpy as np

from ..compiled import alone, kept
from ..errors import Status
from .graphs import graphs, lagrangian_hessian
from .newton import (
    LARGEST_MOVE,
    MOST_TURNS,
    RESIDUAL_LIMIT,
    ROUNDED,
    Solution,
    Solver,
    Turn,
    newton,
    size_of_step,
    status_of,
)
from .transcription import Setting, Transcription

POLISHING, POLISHED = 4, 1e-2
"""Newton steps after IPOPT, and how far they may lead away from its point."""
OPTIMAL_INTERVALS = 500
"""Of a mesh on which IPOPT seeks an extremum: it takes minutes and gigabytes on larger ones."""


def ipopt_then_newton(t: Transcription, u: Array, setting: Setting) -> Solution:
    """IPOPT from where Newton's method may not converge, and Newton's method from where it arrives.

    Returns solution, judged by its distance from `u`.
    """
    found = ipopt(t, u, setting)
    if found.status not in (Status.CONVERGED, Status.NOT_CONVERGED):
        return found
    polished = newton(t, found.u, setting, max_iterations=POLISHING, largest_move=POLISHED)
    if not polished.status.ok:
        return found if not found.status.ok else polished
    status = status_of(t, u, polished.u, polished.residual, True, LARGEST_MOVE)
    return replace(polished, status=status, iterations=found.iterations + polished.iterations)


def solve(
    t: Transcription, u: Array, setting: Setting, *, solver: Solver, border: Array | None = None,
    parameter: float = 0.0, accuracy: float = 0.0, rough: float = 0.0, nearby: float = 0.0, bend: float | None = None,
) -> Solution:  # fmt: skip
    """Solve with the named solver alone.

    border, parameter, accuracy, rough, nearby: as in `newton`; IPOPT always goes for all digits; bend: the extremum of
    lambda is sought, and this is d2 lambda/d a2 along the border row, as of a `Turn`.
    """
    if bend is None:
        if solver == "ipopt":
            return ipopt(t, u, setting, border=border, parameter=parameter)
        return newton(t, u, setting, border=border, parameter=parameter, accuracy=accuracy, rough=rough, nearby=nearby)
    if solver == "ipopt":
        # the extremum of lambda, by IPOPT
        if t.intervals > OPTIMAL_INTERVALS:
            return Solution(u, parameter, Status.NOT_CONVERGED, 0, np.inf, None, "ipopt", bend)
        sense = -float(np.sign(bend))
        moved = setting.moved(parameter)
        best = maximise_parameter(t, u, replace(moved, dp=sense * moved.dp))
        lam, lin = parameter + sense * best.parameter, None
        if best.status.ok:
            lin = t.linearise(best.u, setting.moved(lam))
        residual = np.inf if lin is None else lin.residual_norm()
        return Solution(best.u, lam, best.status, best.iterations, residual, lin, "ipopt", bend)
    turn = Turn(np.array([bend]))
    found = newton(
        t, u, setting, border=border, parameter=parameter, accuracy=accuracy, turn=turn, max_iterations=MOST_TURNS
    )
    return replace(found, bend=float(turn.bend[0]))


Array = np.ndarray

IPOPT_OPTIONS = {
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-9,
    "ipopt.constr_viol_tol": 1e-10,
    "ipopt.acceptable_iter": 0,
    "ipopt.max_iter": 60,
    "ipopt.bound_relax_factor": 0.0,
    # Multipliers of a fold may be large; IPOPT would throw its own good first estimate away and start at zero.
    "ipopt.constr_mult_init_max": 1e20,
    # Starts are good and bounds far: no barrier may drive the first steps along a flat branch.
    "ipopt.mu_init": 1e-11,
    "ipopt.bound_push": 1e-12,
    "ipopt.bound_frac": 1e-12,
    "ipopt.linear_solver": "mumps",
    "print_time": False,
}

ROOT_OPTIONS = {
    # One step more after the equations hold to `tol`: where it is enough, they hold to rounding, and so does the root.
    "ipopt.tol": 1e-15,
    "ipopt.constr_viol_tol": 1e-15,
    "ipopt.acceptable_tol": 1e-9,
    "ipopt.acceptable_constr_viol_tol": 1e-9,
    "ipopt.acceptable_iter": 2,
}
"""Options of a root."""
FOLD_OPTIONS = {
    # Where the equations are lost next to a fold, restoring them leads nowhere; ten steps are the rule.
    "ipopt.max_resto_iter": 0,
    "ipopt.max_iter": 20,
}
"""Options of a largest parameter.  No bounds near by: they change where IPOPT stops, and whether folds are known to the
tolerance."""

MINIMUM_OPTIONS = {
    "ipopt.max_iter": 100,
    "ipopt.mu_init": 1e-3,
    "ipopt.bound_push": 1e-8,
    "ipopt.bound_frac": 1e-8,
}
"""Options of `minimise`: with inequalities a barrier is needed, but starts are good."""


@kept(maxsize=8)
def _ipopt_solver(t: Transcription, goal: Literal["root", "fold"]) -> ca.Function:
    """IPOPT on z = (u, lambda): the root under a border row, or the largest lambda.

    The data of a root are those of graphs.py, the weights of the border row (node_system.py) and its value.
    """
    g = graphs(t)
    if goal == "root":
        places = _border_places(t)
        order = np.argsort(places)
        weights, value = ca.MX.sym("weights", places.size), ca.MX.sym("value")
        data = ca.vertcat(g.data, weights, value)
        rows = ca.vertcat(g.residual, ca.dot(weights, g.z[places.tolist()]) - value)
        border = ca.Sparsity.triplet(1, t.size + 1, [0] * places.size, places[order].tolist())
        jacobian = ca.vertcat(g.jacobian, ca.MX(border, weights[order.tolist()]))
        hessian, objective = ca.MX(t.size + 1, t.size + 1), ca.MX(0)
        nu, options = ca.MX.sym("nu", t.size + 1), IPOPT_OPTIONS | ROOT_OPTIONS
    else:
        data, rows, jacobian, nu = g.data, g.residual, g.jacobian, g.nu
        hessian, objective, options = lagrangian_hessian(t, g), -g.z[t.size], IPOPT_OPTIONS | FOLD_OPTIONS
    jac_g = ca.Function("jac_g", [g.z, data], [rows, jacobian], ["x", "p"], ["g", "jac"])
    hess_lag = ca.Function(
        "hess_lag", [g.z, data, ca.MX.sym("lam_f"), nu], [hessian], ["x", "p", "lam_f", "lam_g"], ["hess_gamma_x_x"]
    )
    problem = {"x": g.z, "p": data, "f": objective, "g": rows}
    return ca.nlpsol(goal, "ipopt", problem, options | {"jac_g": jac_g, "hess_lag": hess_lag})


def _border_places(t: Transcription) -> Array:
    """Where the unknowns that a border row may weigh stand in z, in the order of `NodeSystem.border`."""
    nodes = t.node_index[t.phase_ends].ravel()
    return np.concatenate([nodes, np.arange(t.size - t.phases, t.size + 1)])


def _call(solver: ca.Function, **inputs: Any) -> tuple[dict[str, ca.DM], dict[str, Any]]:
    """What IPOPT returns and how it ended; KeyboardInterrupt where CasADi has made a failure of one.

    Nothing else ends so: an equation that cannot be evaluated is "Invalid_Number_Detected".
    """
    try:
        found = solver(**inputs)
    except (RuntimeError, SystemError) as error:  # the second: "a result with an exception set", which is its cause
        if "KeyboardInterrupt" in str(error) or isinstance(error.__cause__, KeyboardInterrupt):
            raise KeyboardInterrupt from None
        raise
    stats = solver.stats()
    if stats["return_status"] in ("NonIpopt_Exception_Thrown", "User_Requested_Stop"):
        raise KeyboardInterrupt
    return found, stats


@alone
def _run_ipopt(
    t: Transcription, goal: Literal["root", "fold"], z: Array, setting: Setting, row: Array, freedom: float
) -> tuple[Array, Array, bool, int]:
    """(z, multipliers, IPOPT's own verdict, iterations); durations are kept positive, |lambda| <= freedom."""
    solver = _ipopt_solver(t, goal)
    lower, upper = np.full(t.size + 1, -np.inf), np.full(t.size + 1, np.inf)
    lower[t.size - t.phases : t.size] = 0.0
    lower[-1], upper[-1] = -freedom, freedom
    found, stats = _call(
        solver,
        x0=z,
        p=np.concatenate([setting.fractions, setting.p, setting.dp, setting.scale, row]),
        lbx=lower,
        ubx=upper,
        lbg=0.0,
        ubg=0.0,
    )
    z, multipliers = np.array(found["x"]).ravel(), np.array(found["lam_g"]).ravel()
    return z, multipliers, bool(stats["success"]), int(stats["iter_count"])


def ipopt(
    t: Transcription,
    u: Array,
    setting: Setting,
    *,
    border: Array | None = None,
    parameter: float = 0.0,
    largest_move: float = LARGEST_MOVE,
) -> Solution:
    """Solve the square system with IPOPT alone, durations kept positive.

    The point is judged by what Newton's method would still do there: a step that it does not take.

    border, parameter, largest_move: as in `newton`.
    """
    row = t.system.border(parameter=1.0) if border is None else border
    z = np.append(u, parameter)
    value = float(row @ z[_border_places(t)])
    z, _, _, iterations = _run_ipopt(t, "root", z, setting, np.append(row, value), np.inf)
    point, lam, lin = z[:-1], float(z[-1]), None
    status, residual = Status.NOT_FINITE, np.inf
    if np.isfinite(z).all():
        try:
            lin = t.linearise(point, setting.moved(lam))
        except np.linalg.LinAlgError:
            status = Status.SINGULAR
    if lin is not None and lin.finite():
        residual = lin.residual_norm()
        left = size_of_step(t, point, lin.step(row)[0])
        status = status_of(t, u, point, residual, left <= ROUNDED, largest_move)
    return Solution(point, lam, status, iterations, residual, lin, "ipopt")


@dataclass(frozen=True, eq=False)
class Maximum:
    """The largest parameter on a branch, from the optimisation problem.

    Attributes
    ----------
    u, parameter : unknowns and lambda at the maximum.
    multipliers : (size,) IPOPT's multipliers of the equations: the adjoint of the fold,
        d lambda / d q = - multipliers . dG/dq for every parameter q.
    status, iterations : how it ended.
    """

    u: Array
    parameter: float
    multipliers: Array
    status: Status
    iterations: int


def maximise_parameter(t: Transcription, u: Array, setting: Setting, *, freedom: float = 0.01) -> Maximum:
    """Maximise lambda subject to the equations, with IPOPT and the exact Hessian.

    t, u, setting: the equations, and a point near the fold; freedom: |lambda| at which it is no longer near.
    """
    z, multipliers, success, iterations = _run_ipopt(t, "fold", np.append(u, 0.0), setting, np.zeros(0), freedom)
    if not (np.isfinite(z).all() and np.isfinite(multipliers).all()):
        status = Status.NOT_FINITE
    elif not success or abs(z[-1]) >= 0.999 * freedom:
        status = Status.NOT_CONVERGED
    else:
        residual = t.linearise(z[:-1], setting.moved(float(z[-1]))).residual_norm()
        status = Status.CONVERGED if residual < RESIDUAL_LIMIT else Status.NOT_CONVERGED
    return Maximum(z[:-1], float(z[-1]), multipliers, status, iterations)


@dataclass(frozen=True, eq=False)
class Minimum:
    """What IPOPT made of an optimisation problem.

    Attributes
    ----------
    x : the last point.
    status, iterations : how it ended.
    message : IPOPT's own word for that.
    """

    x: Array
    status: Status
    iterations: int
    message: str


@alone
def minimise(
    x: ca.MX, objective: ca.MX, rows: ca.MX, jacobian: ca.MX, start: Array, bounds: Array, row_bounds: Array
) -> Minimum:
    """A small cost under many equations: IPOPT with the Jacobian given and the Hessian that CasADi derives.

    Measured on fold conditions, of which the Hessian takes third derivatives of the collocation equations: 1 s to build
    and 10 to 20 iterations; a limited-memory Hessian needs none and failed wherever the optimum was not at a bound.

    Parameters
    ----------
    x
        (size,) symbol.
    objective, rows, jacobian
        expressions of x: the cost; the equations; their Jacobian, sparse.
    start
        (size,) first point.
    bounds, row_bounds
        (size, 2) and (rows, 2): smallest and largest values.

    Returns
    -------
    Minimum: x, status, iterations, and IPOPT's word.

    Examples
    --------
    >>> import casadi as ca
    >>> import numpy as np
    >>> from casahunt.collocation import minimise
    >>> x, free = ca.MX.sym("x", 2), np.array([[-np.inf, np.inf]] * 2)
    >>> product = x[0] * x[1]
    >>> start, equal = np.array([2.0, 3.0]), np.array([[1.0, 1.0]])
    >>> minimise(x, ca.sumsqr(x), product, ca.jacobian(product, x), start, free, equal).x.round(6).tolist()
    [1.0, 1.0]
    """
    jac_g = ca.Function("jac_g", [x, (none := ca.MX.sym("none", 0))], [rows, jacobian], ["x", "p"], ["g", "jac"])
    problem = {"x": x, "p": none, "f": objective, "g": rows}
    solver = ca.nlpsol("minimum", "ipopt", problem, IPOPT_OPTIONS | MINIMUM_OPTIONS | {"jac_g": jac_g})
    found, stats = _call(
        solver, x0=start, lbx=bounds[:, 0], ubx=bounds[:, 1], lbg=row_bounds[:, 0], ubg=row_bounds[:, 1]
    )
    point = np.array(found["x"]).ravel()
    status = Status.CONVERGED if stats["success"] else Status.NOT_CONVERGED
    if not np.isfinite(point).all():
        status = Status.NOT_FINITE
    return Minimum(point, status, int(stats["iter_count"]), str(stats["return_status"]))
