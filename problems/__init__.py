"""Reference problems, one file each: definition, source and reference values.

Tests, scripts and the README import them; they are not part of the installed package.

The gallery (gallery.py: what its files share; each runs as `python -m problems.NAME --out NAME.png`):

van_der_pol.py        mu from 1 to 1000
circle.py             the normal form of Hopf, beside a state that is zero
rossler.py            a cascade of flips, and the unstable cycles that it leaves
two_spirals.py        two smooth laws side by side
relay.py              relay feedback around linear plants, with and without hysteresis
belt.py               a block on a belt, stick and slip
drill_string.py       two inertias, a flexible shaft, stick and slip
dry_friction.py       forced, with dry friction
impact_oscillator.py  forced, with a stop
bouncing_ball.py      on a shaking table, both branches of its fold, beyond its flip
canudas.py            a servo with LuGre friction, stiff
canudas_gain.py       the same round the fold in its gain, and the lopsided pair

Cycles followed to their birth from a point (hopf_like.py: what the files share): boundary_equilibria.py,
folds_and_foci.py, kicks_and_relays.py.

The servo of the package: table1.py, taylor.py.  Orders of the methods: stuart_landau.py.
"""
