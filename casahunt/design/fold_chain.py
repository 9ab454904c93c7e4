"""Folds of servos in a row, each predicted from the nearest that is known.

    known fold -> all that its expansion reaches, in a batch -> the nearest to the next one, expanded -> ...
                                                                       | nothing reached
                                                                       v
                                                         that servo alone (uncertainty/nearby.py)

A fold is solved and confirmed at its own servo: what it was predicted from decides whether it is found, not what it is.

Units: K in V/rad.  Symbols: n servos, m values of the first parameter, q and r the two parameters.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ..continuation.fold_ensemble import expansion_beside, folds_near
from ..continuation.fold_expansion import Expansion
from ..errors import InputError, NoOrbit, Status
from ..orbits.adapt import Options
from ..servo.hunting import Model
from ..servo.problem import HuntingFold
from ..servo.servo import Servo, flatten
from .uncertainty.batch import known_fold
from .uncertainty.nearby import fold_near

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Chain:
    """Folds over two parameters of a servo.

    Attributes
    ----------
    servo, model : all other values, and the friction model.
    names : the two parameters.
    options : tolerance of every fold.
    """

    servo: Servo
    model: Model
    names: tuple[str, str]
    options: Options

    def folds_along(self, values: Array, start: HuntingFold) -> list[Expansion | None]:
        """The fold at each value of the first parameter, the second as the servo has it.

        values, start: (m,) increasing values, and the servo's own fold.
        Returns folds, m of them; None where none was found.
        """
        own = flatten(self.servo)
        r = own[self.names[1]]
        first = known_fold(self.servo, self.names, start, self.options.tol)
        found: list[Expansion | None] = [None] * values.size
        middle = int(np.argmin(np.abs(values - own[self.names[0]])))
        for way in (range(middle, values.size), range(middle - 1, -1, -1)):
            last = first
            for i in way:
                q = float(values[i])
                found[i] = None if last is None else self._beside(last, q, r)
                if found[i] is None:
                    with suppress(NoOrbit, InputError):
                        found[i] = self._alone(last, q, r)[1]
                last = found[i] or last
        return found

    def gains(self, base: Expansion | None, q: float, values: Array) -> tuple[Array, dict[int, str]]:
        """The fold gains at one value of the first parameter, outwards from a known fold.

        base: a fold at that value, None: none is known; q, values: that value, and (n,) increasing values of the second
        parameter. Returns (n,) gains; 0 where a proof shows that no gain hunts, nan where the fold was not computed,
        and the sentence by index of the latter.
        """
        gains, said = np.full(values.size, np.nan), dict[int, str]()
        bases: dict[float, Expansion] = {}  # those that others are predicted from, by value
        found: dict[float, Expansion] = {}  # from which each was predicted that is found; or that fold itself
        if base is not None:
            found[base.problem.value(self.names[1])] = base
        middle = next(iter(found), float(values.mean()))
        pending = sorted(range(values.size), key=lambda i: abs(values[i] - middle))
        while pending:
            r = float(values[pending[0]])
            at = min(found, key=lambda known: abs(known - r), default=None)
            near = None if at is None else found[at]
            if at is not None and at not in bases:
                is_its_own = found[at].problem.value(self.names[1]) == at
                near = found[at] if is_its_own else self._beside(found[at], q, at)
                if near is None:
                    del found[at]
                    continue
                bases[at] = near
                pending = self._reached(near, q, values, pending, gains, found)
                continue
            i = pending.pop(0)
            try:
                gains[i], fold = self._alone(near, q, r)
            except NoOrbit as error:
                said[i] = str(error)
                continue
            if fold is not None:
                found[r] = fold
        return gains, said

    def _reached(
        self, near: Expansion, q: float, values: Array, pending: list[int], gains: Array, found: dict[float, Expansion]
    ) -> list[int]:
        """What is left of the servos when those that a fold leads to are computed, into `gains` and `found`."""
        folds = folds_near(near, self._p(q, values[pending]), self.options.tol)
        left = []
        for k, i in enumerate(pending):
            if folds.statuses[k] is Status.CONVERGED:
                gains[i] = folds.values[k]
                found[float(values[i])] = near
            else:
                left.append(i)
        return left

    def _beside(self, near: Expansion, q: float, r: float) -> Expansion | None:
        """The fold at (q, r), predicted."""
        return expansion_beside(near, self._p(q, np.array([r]))[0], self.options.tol)

    def _alone(self, near: Expansion | None, q: float, r: float) -> tuple[float, Expansion | None]:
        """The fold gain at (q, r), and the fold to predict others from; 0 and None where no gain hunts.

        Raises InputError: no servo has these values.; NoOrbit: the fold was not computed.
        """
        servo = self.servo.replace(**dict(zip(self.names, (q, r), strict=True)))
        expected = np.nan
        if near is not None:
            expected = float(near.there(near.expected(self._p(q, np.array([r]))))[1][0])
        fold = fold_near(servo, self.model, expected, self.options)
        if fold is None:
            return 0.0, None
        return fold.gain, known_fold(servo, self.names, fold, self.options.tol)

    def _p(self, q: float, values: Array) -> Array:
        """(n, np) parameters."""
        p = np.repeat(self.servo.parameters(1.0)[None], values.size, axis=0)
        p[:, self.servo.names.index(self.names[0])] = q
        p[:, self.servo.names.index(self.names[1])] = values
        return p
