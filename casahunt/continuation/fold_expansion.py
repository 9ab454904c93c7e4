"""A known fold and how it changes with parameters: where the folds of problems nearby are to be expected.

    z(q) = z_0 + sum_i dz/dl_i (l_i - l_i0) + 1/2 d2z/dl_i^2 (l_i - l_i0)^2,     l = ln q,    z = (x, ln T, ln value)

Symbols: B members, k parameters that differ, n states, P phases.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ..collocation.scheme import Kind
from ..collocation.transcription import Setting, Transcription, transcribe
from ..hybrid.problem import Problem
from ..hybrid.system import Signature
from .curve import along

Array = np.ndarray

FARTHEST = 2.0
"""Largest logarithm by which a duration or the value is expected to change."""


@dataclass(frozen=True, eq=False)
class Expansion:
    """A known fold, and how it changes with parameters; arrays alone, so that any worker can be sent it.

    Attributes
    ----------
    problem : at the fold.
    vary : name of the parameter that is largest there.
    signature, repeats, counts, degree, kind : its cycle and mesh.
    u : (size,) unknowns.
    fractions, scale : of its setting.
    row : (n + 2,) along the curve, without lambda.
    bend : d2 lambda/d a2 there.
    names : the k parameters of the expansion.
    first, second : (k, size + 1) derivatives of (x, ln T, ln value) by the logarithms of the parameters.
    """

    problem: Problem
    vary: str
    signature: Signature
    repeats: int
    counts: tuple[int, ...]
    degree: int
    kind: Kind
    u: Array
    fractions: Array
    scale: Array
    row: Array
    bend: float
    names: tuple[str, ...] = ()
    first: Array = field(default_factory=lambda: np.zeros((0, 0)))
    second: Array = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def t(self) -> Transcription:
        """Its transcription."""
        return transcribe(self.problem.cycle(self.signature, self.repeats), self.counts, self.degree, self.kind)

    def setting(self) -> Setting:
        """Its setting, lambda being the parameter in its unit."""
        return Setting(self.fractions, self.problem.vector(), self.scale, along(self.problem, self.vary))

    def expected(self, p: Array) -> Array:
        """(B, size + 1) changes of (x, ln T, ln value) expected at parameters p (B, np)."""
        t, own = self.t, self.problem.vector()
        at = [self.problem.names.index(name) for name in self.names]
        usable = (own[at] > 0) & (p[:, at] > 0)
        logs = np.log(np.where(usable, p[:, at], 1.0) / np.where(own[at] > 0, own[at], 1.0))
        logs = np.where(usable, logs, 0.0)
        change = np.zeros((len(p), t.size + 1))
        for i in range(len(at)):  # in turn, so that no sum depends on how many members there are
            change += logs[:, i : i + 1] * (self.first[i] + 0.5 * logs[:, i : i + 1] * self.second[i])
        return change

    def there(self, change: Array) -> tuple[Array, Array]:
        """(unknowns (B, size), value of the parameter (B,)) after changes (B, size + 1) of (x, ln T, ln value)."""
        t = self.t
        change = change.copy()
        change[:, -1 - t.phases :] = np.clip(change[:, -1 - t.phases :], -FARTHEST, FARTHEST)
        u = self.u + change[:, :-1]
        u[:, -t.phases :] = self.u[-t.phases :] * np.exp(change[:, -1 - t.phases : -1])
        return u, self.problem.value(self.vary) * np.exp(change[:, -1])

    def changes(self, u: Array, values: Array) -> Array:
        """What leads from the known fold to another point.

        u, values: (B, size) unknowns, and (B,) values of the parameter.
        Returns (B, size + 1) changes of (x, ln T, ln value).
        """
        P = self.t.phases
        change = np.column_stack([u - self.u, np.log(values / self.problem.value(self.vary))])
        change[:, -1 - P : -1] = np.log(u[:, -P:] / self.u[-P:])
        return change

    def halfway(self, p: Array) -> Array:
        """(B, np) parameters halfway to p (B, np), in logarithms where both ends are positive."""
        own = self.problem.vector()
        positive = (own > 0) & (p > 0)
        with np.errstate(invalid="ignore"):
            return np.where(positive, np.sqrt(own * p), (own + p) / 2)
