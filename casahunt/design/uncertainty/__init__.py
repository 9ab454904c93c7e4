"""How far an uncertain servo moves its fold gain: linearised, sampled, and at the worst corner.

    linear K(q0) + g . (q - q0);    samples K(q_j);    worst max K(q) over l <= q <= h

K(q) is the fold gain of the servo with the parameters q (servo.PARAMETERS without the gain), of which k are uncertain:
either each in an interval [l_i, h_i], or all together with a covariance C about the servo's own values q0.

K is 0 where a proof shows that the servo hunts at no gain (servo/denial.py; with static = Coulomb friction and a stable
loop that of Bisoffi et al.), and static < Coulomb is no friction at all.  A search that meets no cycle is a failure.

set.py            what is uncertain: intervals, or a covariance; the box of it; read from a file
samples.py        servos drawn from the uncertainty, and their fold gains
worst_corner.py   the largest fold gain in the box
summary.py        the gradient's answer, and the three side by side: where the linear answer misleads
"""
