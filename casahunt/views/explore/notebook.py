"""`casahunt.explore`: the page of a servo from Python, in a browser or in a notebook's own page."""

from __future__ import annotations

from html import escape

from ...checks import require
from ...servo.friction import Model
from ...servo.parts import Loop
from ...servo.servo import Servo, a_servo
from .state import FIRST_GAIN, State, state_of_loop, state_of_servo


class Explorer:
    """A page that is served until it is closed, or Python ends.

    Attributes
    ----------
    address : of the page, for any browser of this machine.
    """

    def __init__(self, first: State, port: int | None) -> None:
        from .server import Server  # tornado and Bokeh: not before a page is asked for

        self._server = Server(first, port=port)
        self._server.start()
        self.address = self._server.address

    def close(self) -> None:
        """End it, with its processes."""
        self._server.close()

    def __repr__(self) -> str:
        return f"<Explorer: {self.address.partition('?')[0]}>"

    def _repr_html_(self) -> str:
        return f'<iframe src="{escape(self.address)}" width="100%" height="900" title="explore"></iframe>'


def explore(
    servo: Servo | Loop | None = None, model: Model = "switch", gain: float = FIRST_GAIN, *, port: int | None = None
) -> Explorer:
    """A page on which a servo is turned, and at once answers.

    Parameters
    ----------
    servo
        a servo, or a loop of parts with a gain of its own; default Table 1.
    model, gain
        friction model, and gain [V/rad], of a servo.
    port
        at which it is served; default a free one.

    Returns
    -------
    Explorer: in a notebook the page itself; else its `address` is opened in a browser.  `close()` ends it.

    Raises
    ------
    InputError : a value out of range, a port that is taken, or Bokeh is not installed.

    Examples
    --------
    >>> from casahunt import InputError, Servo, explore
    >>> try:
    ...     explore(Servo(), gain=-1.0)
    ... except InputError as refusal:
    ...     print(refusal)
    gain = -1: must be greater than 0
    """
    if isinstance(servo, Loop):
        return Explorer(state_of_loop(tuple(part.name for part in servo.parts), servo), port)
    first = state_of_servo(Servo() if servo is None else a_servo(servo)).choose("model", model)
    first = State({**first.values, "gain": require("gain", gain, above=0)}, first.model)
    return Explorer(first, port)
