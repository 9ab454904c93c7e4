"""casahunt explore: a page in the browser, on which the servo is turned, and at once answers.

Key of the JSON object, which is printed when the page can be loaded: address.
"""

from __future__ import annotations

import json
import webbrowser
from dataclasses import replace
from typing import Any

from ...axis_units import shown
from ...errors import InputError
from ...servo.drive import Drive
from ...servo.units import GAIN_UNIT
from ..explore.state import state_of_loop, state_of_servo
from .arguments import Asked, add_command, count_of, positive
from .progress import say


def add(commands: Any) -> None:
    """The arguments of the command."""
    about = "a page in the browser: turn the servo, and see"
    command = add_command(commands, "explore", about, tol=False, model="")
    command.add_argument("--gain", dest="first", metavar="K", help="gain in V/rad to begin with (default 0.1)")
    command.add_argument("--port", metavar="N", help="port of the page (default: the first free one from 8765)")
    command.add_argument("--host", help="who may connect: default this machine alone; 0.0.0.0 for the whole network")
    command.add_argument("--no-browser", action="store_true", help="print the address and open no browser")


def run(options: Asked) -> int:
    """Serve until it is interrupted; returns the exit code."""
    from ..explore.server import THIS_MACHINE, Server  # not for who asks for --help

    if not shown().plain:
        raise InputError(
            "explore: its page is in SI, of a rotary axis; leave [units] out of the file, with every number in SI, and "
            "rad stands for m, N m for N; or ask casahunt simulate, orbit, fold and remedies"
        )
    port = None if options.port is None else count_of("port", options.port, 1, 65535)
    loop = options.loop()
    gain = {} if options.first is None else {"gain": positive("gain", options.first, GAIN_UNIT)}
    if loop is not None:
        first = state_of_loop(options.tables()["loop"]["parts"], loop)
    else:
        first = state_of_servo(options.servo()).choose("model", options.friction_model())
    drive = options.drive() if loop is None else None
    built = {} if drive is None else {k: v for k, v in vars(drive).items() if v != getattr(Drive, k, None)}
    first = replace(first, values={**first.values, **gain}, drive=built)
    server = Server(first, host=options.host or THIS_MACHINE, port=port)
    if opened := server.opened():
        say(opened)
    if options.json:
        print(json.dumps({"address": server.address}), flush=True)
    else:
        print(server.address, flush=True)
        say("the page is served until Ctrl-C")
    if not options.no_browser:
        webbrowser.open(server.address)
    server.run()
    return 0
