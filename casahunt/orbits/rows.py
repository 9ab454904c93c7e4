"""An ensemble as a table: a row for every member.

q_1 ... q_k | every array of n values, by the singular of its name | status | how

A complex array is two columns, its real and its imaginary parts.
"""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import numpy as np

from ..export import Columns
from ..results import Result


class Rows(Result):
    """A frozen record of n members: `names` (k) and `parameters` (n, k), arrays of results, `statuses`, `how`."""

    _quantities = ("members = how.size", "names")
    _details = ("failures",)

    names: tuple[str, ...]
    parameters: np.ndarray
    statuses: tuple[Any, ...]
    how: tuple[str, ...]

    def _columns(self) -> Columns:
        n, columns = len(self.how), dict(zip(self.names, self.parameters.T, strict=True))
        for field in fields(self):  # type: ignore[arg-type]
            values, word = getattr(self, field.name), _singular(field.name)
            if field.name == "parameters" or not isinstance(values, np.ndarray) or values.shape[:1] != (n,):
                continue
            if np.iscomplexobj(values):
                columns |= {f"{word}_real": values.real, f"{word}_imag": values.imag}
                continue
            columns |= {word: values} if values.ndim == 1 else {
                f"{word} of {name}": column for name, column in zip(self.names, values.T, strict=False)
            }  # fmt: skip
        return {**columns, "status": self.statuses, "how": self.how}


def _singular(word: str) -> str:
    return f"{word[:-3]}y" if word.endswith("ies") else word.removesuffix("s")
