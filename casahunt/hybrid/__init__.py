"""What a hybrid system is, as data.

    x' = f_k(x; p) in mode k,    h(x, T; p) = 0 on the way out of it

system.py    modes, exits and phases; a cycle x(start) = S x(end) as phases in order
vector_form.py  functions of named states and parameters as functions of vectors
problem.py   the contract: what the engine must know of whoever poses a problem
jumps.py     whether a field jumps where its mode goes on
expressions.py  what a user's functions return, checked
language.py  what a user writes: Event, Mode, System with names
examples.py  two small systems, which the examples take
"""

from typing import TYPE_CHECKING

from ..lazy import lazily

if TYPE_CHECKING:
    from .language import Event, Mode, System

__all__ = ["Event", "Mode", "System"]
__getattr__ = lazily(__name__)
