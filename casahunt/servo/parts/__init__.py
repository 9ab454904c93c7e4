"""A loop is made of parts: plant, friction, controller, loads and limits, remedies; their product is a `System`.

    x' = product of the parts' fields,   modes = tuples of their modes,   y = signals that they exchange

part.py                  the words: Part, PartMode, Law, Edge
wiring.py                the parts in one mode each, wired by their signals
functions.py             fields, flows, events and resets of wired parts
product.py               the product of parts, as a system like any user's
loop.py                  parts and their numbers, and what is asked of them by name
remedy.py                what is to be known of a part to find and to price its smallest size
inertia.py               plant: one inertia
two_masses.py            plant: motor and load with a shaft
switch.py                Switch friction, of the motor and of the load, and by direction
with_exponent.py         Switch friction whose drop has an exponent of its own
tabulated.py             Switch friction by a table of velocity and torque
lugre.py                 LuGre friction
pid.py                   PID by times or by gains, and the integrator
filtered_derivative.py   a filter of the derivative of any PID
cascade.py               cascade P-PI, its velocity filtered or not
linear_controller.py     any linear controller, by its state space
linear_forms.py          any linear controller, by its transfer function or another package's object
filters.py               filters behind a controller: lead, notch, low-pass
loads.py                 a constant torque, a spring
torque_limit.py          a limited torque, with anti-windup
dead_band.py             remedies: dead bands on the integrator's input, or on the error
leak.py                  remedy: a leaking integrator
freeze.py                remedy: an integrator that is frozen at standstill
reset.py                 remedies: an integrator that is reset
error_filter.py          remedy: a filtered error
feedforward.py           remedy: friction compensated by its estimate
dither.py                remedy: dither, by its averaged friction curve
table.py                 all remedies
plain_loop.py            a servo as a loop
file.py                  a loop in a file
turns.py                 whether the turns of a motion repeat, or its swings become ever smaller
fate.py                  what becomes of a motion of a loop, event by event
exponent.py              the largest exponent of hunting
ahead.py                 what lies ahead of a motion, behind its end
verbs.py                 cycle and motion of a loop
"""

from typing import TYPE_CHECKING

from ...lazy import lazily

if TYPE_CHECKING:
    from .cascade import P_PI, P_PI_FILTERED
    from .dead_band import DEAD_BAND, ERROR_DEAD_BAND, HYSTERESIS, SHIFTED_DEAD_BAND
    from .dither import DITHERED
    from .error_filter import ERROR_FILTER
    from .feedforward import FEEDFORWARD
    from .file import load_loop
    from .filtered_derivative import DERIVATIVE_FILTER, DERIVATIVE_FILTER_BY_N
    from .filters import series
    from .freeze import FREEZE
    from .inertia import INERTIA
    from .leak import LEAK
    from .linear_controller import state_space
    from .linear_forms import from_object, transfer_function
    from .loads import LOADS
    from .loop import Loop
    from .lugre import LUGRE
    from .part import Edge, Law, Part, PartMode
    from .pid import INTEGRATOR, PID_BY_GAINS, PID_BY_TIMES
    from .plain_loop import loop_of
    from .remedy import Remedy
    from .reset import RESET_AT_CENTRE, RESET_AT_STOP, RESET_AT_ZERO
    from .switch import BY_DIRECTION, LOAD_SWITCH, NO_FRICTION, SWITCH
    from .table import REMEDIES
    from .tabulated import friction_table
    from .torque_limit import BACK_CALCULATION, CLAMPING, TORQUE_LIMIT
    from .two_masses import TWO_MASSES, TWO_MASSES_LOAD_SEEN
    from .with_exponent import WITH_EXPONENT

__all__ = [
    "BACK_CALCULATION", "BY_DIRECTION", "CLAMPING", "DEAD_BAND", "DERIVATIVE_FILTER", "DERIVATIVE_FILTER_BY_N",
    "DITHERED", "ERROR_DEAD_BAND", "ERROR_FILTER", "FEEDFORWARD", "FREEZE", "HYSTERESIS", "INERTIA", "INTEGRATOR",
    "LEAK", "LOADS", "LOAD_SWITCH", "LUGRE", "NO_FRICTION", "PID_BY_GAINS", "PID_BY_TIMES", "P_PI", "P_PI_FILTERED",
    "REMEDIES", "RESET_AT_CENTRE", "RESET_AT_STOP", "RESET_AT_ZERO", "SHIFTED_DEAD_BAND", "SWITCH", "TORQUE_LIMIT",
    "TWO_MASSES", "TWO_MASSES_LOAD_SEEN", "WITH_EXPONENT", "Edge", "Law", "Loop", "Part", "PartMode", "Remedy",
    "friction_table", "from_object", "load_loop", "loop_of", "series", "state_space", "transfer_function",
]  # fmt: skip
__getattr__ = lazily(__name__)
