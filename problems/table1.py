"""The servo of Table 1 and its symmetric hunting cycles, computed independently of this package.

Source of the servo: Hensen, van de Molengraft and Steinbuch, "Friction induced limit cycling: hunting",
DCT report 2001.021, TU Eindhoven, Table 1 and section 2; later form Automatica 39 (2003) 2131-2137.

Source of the reference values: independent programs that use no collocation.  Switch orbits: Taylor series with 34
digits (mu at K = 0.04: with 50, by differences of the event map).  LuGre orbits and folds: a Taylor series integrator
of order 22 in extended precision and an explicit Runge-Kutta method with event location.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from casahunt.servo.servo import Servo, load

TOML = Path(__file__).with_name("table1.toml")
"""The servo as a file."""


def servo() -> Servo:
    """The servo of Table 1, read from its file."""
    return load(TOML)


# Symmetric hunting cycles of the servo of Table 1 (tau_i = tau_d = 1/(2 pi)). amplitude = max |x1| [rad],
# period [s], mu = half-map multiplier (lambda = mu^2). Switch orbits are correct as printed, all else to the last digit
# but one.
REFERENCE: dict[str, Any] = {
    "switch": {
        "stable": [
            {"K": 0.04, "amplitude": 0.05004697268811118, "period": 10.28141517437786, "mu": -0.1504771775604},
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
        "fold": {"K": 0.647339083653, "amplitude": 0.00155239272991, "period": 20.46831056},
    },
    "lugre": {
        "stable": [
            {"K": 0.04, "amplitude": 0.0495303366414, "period": 10.3786464751, "mu": -0.161939119167},
            {"K": 0.1, "amplitude": 0.0176380762516, "period": 11.4124797799, "mu": -0.399840670636},
            {"K": 0.2, "amplitude": 0.00782242867335, "period": 12.8499782911, "mu": -0.530870274096},
            {"K": 0.4, "amplitude": 0.00330875711878, "period": 15.3854238033, "mu": -0.631970470698},
            {"K": 0.6, "amplitude": 0.00190966597256, "period": 18.1687313151, "mu": -0.665005336528},
        ],
        "unstable": [
            {"K": 0.6, "amplitude": 0.00171950503173, "period": 20.4242712083, "mu": 138.0098927},
            {"K": 0.4, "amplitude": 0.00128435343474, "period": 41.6956121419, "mu": 75814.18348},
            {"K": 0.1, "amplitude": 0.000684943288608, "period": 319.903076124, "mu": 824.5731812},
        ],
        "fold": {"K": 0.62029658679, "amplitude": 0.00179289767706, "period": 18.8436642809},
    },
    # Measured on the machine: report, section 2, averages over consecutive periods.
    "experiment": {"K": 0.04, "amplitude": 0.061, "frequency_hz": 0.122},
}
"""{model: {"stable": rows, "unstable": rows, "fold": row}} and the "experiment"; K is the controller gain."""
