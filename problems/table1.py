"""The servo of Table 1 and its symmetric hunting cycles, computed independently of this package.

Source of the servo: Hensen, van de Molengraft and Steinbuch, "Friction induced limit cycling: hunting",
DCT report 2001.021, TU Eindhoven, Table 1 and section 2; later form Automatica 39 (2003) 2131-2137.

Source of the reference values: independent programs that use no collocation.  Switch orbits and fold: Taylor series
with 34 digits (scripts/peers/switch_digits.py; mu at K = 0.04: with 50, by differences of the event map).  LuGre:
Taylor series with events in quadruple precision (scripts/peers/lugre_digits.py), amplitudes and periods the same in
extended precision to what rounding leaves there; its fold in extended precision.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from casahunt import Servo, load

TOML = Path(__file__).with_name("table1.toml")
"""The servo as a file."""


def servo() -> Servo:
    """The servo of Table 1, read from its file."""
    return cast(Servo, load(TOML))


# Symmetric hunting cycles of the servo of Table 1 (tau_i = tau_d = 1/(2 pi)). amplitude = max |x1| [rad],
# period [s], mu = half-map multiplier (lambda = mu^2). Amplitudes and periods are correct as printed, the LuGre fold to
# its last digit but one, where it is ill-determined in its amplitude and period; mu of LuGre to ten digits.
REFERENCE: dict[str, Any] = {
    "switch": {
        "stable": [
            {"K": 0.04, "amplitude": 0.05004697268811118, "period": 10.281415174414420, "mu": -0.1504771775604},
            {"K": 0.1, "amplitude": 0.01770844749653121, "period": 11.35587139099579, "mu": -0.3879188693678},
            {"K": 0.2, "amplitude": 0.007764513186530966, "period": 12.89423233772457, "mu": -0.5199160678836},
            {"K": 0.4, "amplitude": 0.003193789643761574, "period": 15.76984996646879, "mu": -0.6233241532726},
            {"K": 0.6, "amplitude": 0.001777843709586452, "period": 19.12452294008593, "mu": -0.6893612871863},
        ],
        "unstable": [
            {"K": 0.1, "amplitude": 0.0003477672348428777, "period": 606.3737954953064, "mu": 92.26025528109},
            {"K": 0.4, "amplitude": 0.0009630952315224778, "period": 54.40405236946379, "mu": 105792.7709501},
            {"K": 0.61, "amplitude": 0.001436894986308148, "period": 23.62311525127907, "mu": 829.0501355557},
        ],
        "fold": {"K": 0.647339083653448923, "amplitude": 0.00155239272990702783, "period": 20.4683105561142084},
    },
    "lugre": {
        "stable": [
            {"K": 0.04, "amplitude": 0.0495303366414300166, "period": 10.3786464751026075, "mu": -0.1619391192120},
            {"K": 0.1, "amplitude": 0.0176380762515911020, "period": 11.4124797799322775, "mu": -0.3998406706422},
            {"K": 0.2, "amplitude": 0.00782242867335300388, "period": 12.8499782910543630, "mu": -0.5308702741061},
            {"K": 0.4, "amplitude": 0.00330875711878108137, "period": 15.3854238032915644, "mu": -0.6319704706976},
            {"K": 0.6, "amplitude": 0.00190966597255880714, "period": 18.1687313150904978, "mu": -0.6650053364038},
        ],
        "unstable": [
            {"K": 0.6, "amplitude": 0.00171950503172620925, "period": 20.4242712083492006, "mu": 138.0098927663},
            {"K": 0.4, "amplitude": 0.00128435343474084824, "period": 41.6956121418996589, "mu": 75814.18347865},
            {"K": 0.1, "amplitude": 0.000684943288607766660, "period": 319.903076123734667, "mu": 824.5731809061},
        ],
        "fold": {"K": 0.620296586794437, "amplitude": 0.0017928976770695, "period": 18.8436642808205},
    },
    # Measured on the machine: report, section 2, averages over consecutive periods.
    "experiment": {"K": 0.04, "amplitude": 0.061, "frequency_hz": 0.122},
}
"""{model: {"stable": rows, "unstable": rows, "fold": row}} and the "experiment"; K is the controller gain."""
