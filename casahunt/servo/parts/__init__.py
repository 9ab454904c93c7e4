"""A loop is made of parts: plant, friction, controller, loads and limits, remedies; their product is a `System`.

    x' = product of the parts' fields,   modes = tuples of their modes,   y = signals that they exchange

part.py                  the words: Part, PartMode, Law, Edge
addresses.py             where parts and their functions stand, for other processes
wiring.py                the parts in one mode each, wired by their signals
loop.py                  the product of parts, as a system like any user's
remedy.py                what is to be known of a part to find and to price its smallest size
inertia.py               plant: one inertia
two_masses.py            plant: motor and load with a shaft
switch.py                Switch friction
by_direction.py          Switch friction that differs by direction
lugre.py                 LuGre friction
pid.py                   PID by times or by gains, and the integrator
cascade.py               cascade P-PI
filtered_derivative.py   PID by gains with a filtered derivative
linear_controller.py     any linear controller, by state space or transfer function
loads.py                 a constant torque, a spring
torque_limit.py          a limited torque, with anti-windup
dead_band.py             remedies: dead bands on the integrator's input, or on the error
leak.py                  remedy: a leaking integrator
freeze.py                remedy: an integrator that is frozen at standstill
reset.py                 remedies: an integrator that is reset
error_filter.py          remedy: a filtered error
feedforward.py           remedy: friction compensated by its estimate
dither.py                remedy: dither, by its averaged friction curve
plain.py                 remedies: gain, derivative and integral action
table.py                 all remedies
plain_loop.py            a servo as a loop
file.py                  a loop in a file
verbs.py                 cycle and motion of a loop
"""

from typing import TYPE_CHECKING

from ...lazy import lazily

if TYPE_CHECKING:
    from .by_direction import BY_DIRECTION
    from .cascade import P_PI
    from .dead_band import DEAD_BAND, ERROR_DEAD_BAND, HYSTERESIS, SHIFTED_DEAD_BAND
    from .dither import DITHERED
    from .error_filter import ERROR_FILTER
    from .feedforward import FEEDFORWARD
    from .file import load_loop
    from .filtered_derivative import PID_WITH_FILTER
    from .freeze import FREEZE
    from .inertia import INERTIA
    from .leak import LEAK
    from .linear_controller import from_object, state_space, transfer_function
    from .loads import LOADS
    from .loop import Loop
    from .lugre import LUGRE
    from .part import Edge, Law, Part, PartMode
    from .pid import INTEGRATOR, PID_BY_GAINS, PID_BY_TIMES
    from .plain_loop import loop_of
    from .remedy import Remedy
    from .reset import RESET_AT_CENTRE, RESET_AT_STOP, RESET_AT_ZERO
    from .switch import SWITCH
    from .table import REMEDIES
    from .torque_limit import BACK_CALCULATION, CLAMPING, TORQUE_LIMIT
    from .two_masses import TWO_MASSES, TWO_MASSES_LOAD_SEEN
    from .verbs import LoopMotion, fold_in, loop_cycle, loop_motion, unstable_cycle

__all__ = [
    "BACK_CALCULATION", "BY_DIRECTION", "CLAMPING", "DEAD_BAND", "DITHERED", "ERROR_DEAD_BAND", "ERROR_FILTER",
    "FEEDFORWARD", "FREEZE", "HYSTERESIS", "INERTIA", "INTEGRATOR", "LEAK", "LOADS", "LUGRE", "PID_BY_GAINS",
    "PID_BY_TIMES", "PID_WITH_FILTER", "P_PI", "REMEDIES", "RESET_AT_CENTRE", "RESET_AT_STOP", "RESET_AT_ZERO",
    "SHIFTED_DEAD_BAND", "SWITCH", "TORQUE_LIMIT", "TWO_MASSES", "TWO_MASSES_LOAD_SEEN", "Edge", "Law", "Loop",
    "LoopMotion", "Part", "PartMode", "Remedy", "fold_in", "from_object", "load_loop", "loop_cycle", "loop_motion",
    "loop_of", "state_space", "transfer_function", "unstable_cycle",
]  # fmt: skip
__getattr__ = lazily(
    __name__,
    {
        "by_direction": ("BY_DIRECTION",),
        "cascade": ("P_PI",),
        "dead_band": ("DEAD_BAND", "ERROR_DEAD_BAND", "HYSTERESIS", "SHIFTED_DEAD_BAND"),
        "dither": ("DITHERED",),
        "error_filter": ("ERROR_FILTER",),
        "feedforward": ("FEEDFORWARD",),
        "filtered_derivative": ("PID_WITH_FILTER",),
        "file": ("load_loop",),
        "freeze": ("FREEZE",),
        "inertia": ("INERTIA",),
        "leak": ("LEAK",),
        "linear_controller": ("from_object", "state_space", "transfer_function"),
        "loads": ("LOADS",),
        "loop": ("Loop",),
        "lugre": ("LUGRE",),
        "part": ("Edge", "Law", "Part", "PartMode"),
        "pid": ("INTEGRATOR", "PID_BY_GAINS", "PID_BY_TIMES"),
        "plain_loop": ("loop_of",),
        "remedy": ("Remedy",),
        "reset": ("RESET_AT_CENTRE", "RESET_AT_STOP", "RESET_AT_ZERO"),
        "switch": ("SWITCH",),
        "table": ("REMEDIES",),
        "torque_limit": ("BACK_CALCULATION", "CLAMPING", "TORQUE_LIMIT"),
        "two_masses": ("TWO_MASSES", "TWO_MASSES_LOAD_SEEN"),
        "verbs": ("LoopMotion", "fold_in", "loop_cycle", "loop_motion", "unstable_cycle"),
    },
)
