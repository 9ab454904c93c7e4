r"""Formulas as MathML, which browsers draw themselves: the site is built and read without a network.

docutils has the converter; what it does not know is an error of the build.  The subscript of an accented letter it puts
below the letter, as in \dot x_1: that is written \dot x{}_1.
"""

from __future__ import annotations

import re
from typing import Any

from docutils import nodes
from docutils.utils.math.latex2mathml import tex2mathml

MISPLACED = re.compile(r"\\(?:dot|ddot|hat|bar|tilde|vec)\s*(?:\w|\{\w+\})\s*_")
"""A subscript that would stand below its letter."""


def mathml(formula: str, *, block: bool = False) -> str:
    """A formula in LaTeX as MathML.

    Raises ValueError: a subscript of an accented letter; docutils' own: what it does not know.
    """
    if found := MISPLACED.search(formula):
        raise ValueError(f"{found.group()}: write {found.group()[:-1].rstrip()}{{}}_")
    return tex2mathml(formula, as_block=block).replace("<mo>'</mo>", "<mo>\N{PRIME}</mo>")


def _inline(writer: Any, node: nodes.Element) -> None:
    writer.body.append(mathml(node.astext()))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.Element) -> None:
    writer.body.append(f'<div class="formula">{mathml(node.astext(), block=True)}</div>\n')
    raise nodes.SkipNode


def setup(app: Any) -> dict[str, bool]:
    """Make it known to Sphinx as html_math_renderer = "mathml"."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    return {"parallel_read_safe": True, "parallel_write_safe": True}
