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
Branches whose special points and ends are known (`branches`, followed by scripts/branches.py), as those of rossler.py
and canudas_gain.py:

rings.py              folds, flips, a torus, an isola in closed form
lorenz.py             a Hopf point, homoclinic orbits, a loss of symmetry, a fold
brusselator.py        the birth of a cycle
fitzhugh_nagumo.py    canards: folds that no step sees
hindmarsh_rose.py     spikes that flip
morris_lecar.py       Hopf points, folds, a saddle-node on the cycle
duffing.py            forced: folds, a loss of symmetry, a flip
chua.py               three linear zones, cycles that fill a disc
dead_band.py          a servo whose integrator rests next to the set point: a fold against an event map
gears.py              forced, with backlash: grazings in closed form
impact_pair.py        a ball between two walls: a fold and a loss of symmetry in closed form
threshold_harvest.py  a cycle that comes to slide
cubic_friction.py     stick and slip, slip alone, rest
buck.py               a converter with a clock, its cascade
ends.py               ends that few branches have: without bound, to a point, at a level

The servo of the package: table1.py, taylor.py.  Orders of the methods: stuart_landau.py.  Cycles whose phases never
change their order: fixed_sequence.py.
"""
