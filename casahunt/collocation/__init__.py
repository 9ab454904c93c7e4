"""From a cycle and a mesh to a solved boundary value problem, with its error.

    x_0 + h T sum_j a_ij f(X_j) = X_i,    h_k(x(end of k), T_k; p) = 0,    x_0 = S x_E       G(u, lambda) = 0

scheme.py         nodes, weights, interpolation: pure numpy
interval.py       one collocation interval, compiled, with its exact Jacobian
elimination.py    its stages eliminated: positions by substitution, the rest by LU
substitution.py   the same as expressions, for one interval by itself
ensemble_points.py fields and stages of many members, over arrays
joints.py         closed-form phases and events, compiled, with their exact Jacobians
node_system.py    the linear system left when the stages are eliminated
transcription.py  cycle + mesh -> equations, condensed Jacobian, layout of the unknowns
graphs.py         the same equations as graphs for optimisation, with Jacobian and Hessian
newton.py         Newton's method, and when a solution is one
ipopt.py          IPOPT: a root, the largest parameter, a small cost
mesh.py           the same solution on another mesh
error_estimate.py the error of what is read from a solution, by an adjoint
batched_newton.py solutions on meshes of parts, corrected many at once
remesh.py         the mesh that makes it as small as asked for
conditions.py     what the phases say of solutions: conditions, features, events there
resolution.py     how well a condition is known inside an interval
successors.py     does an event lead to the mode that follows?
admissibility.py  is a root of the equations a motion?
"""

from typing import TYPE_CHECKING

from ..lazy import lazily

if TYPE_CHECKING:
    from .ipopt import minimise
    from .joints import flow_at
    from .scheme import Scheme

__all__ = ["Scheme", "flow_at", "minimise"]
__getattr__ = lazily(__name__)
