"""How far an uncertain servo moves its fold gain: linearised, sampled, and at the worst corner.

    linear K(q0) + g . (q - q0);    samples K(q_j);    worst max K(q) over l <= q <= h

K(q) is the fold gain of the servo with the parameters q (servo.PARAMETERS without the gain), of which k are uncertain:
either each in an interval [l_i, h_i], or all together with a covariance C about the servo's own values q0.

K is 0 where a proof shows that the servo hunts at no gain (servo/denial.py; with static = Coulomb friction and a stable
loop that of Bisoffi et al.), and static < Coulomb is no friction at all.  A search that meets no cycle is a failure.

set.py            what is uncertain: intervals, or a covariance; the box of it
toml.py           an uncertainty read from a file
linear.py         the gradient's answer: range, mean and standard deviation
nearby.py         folds of servos nearby, looked for where one of them lets them be expected
batch.py          many of them at once, in batches that any executor may share out
samples.py        servos drawn from the uncertainty, and their fold gains
worst_corner.py   the largest fold gain in the box
summary.py        the three side by side: where the linear answer misleads
"""
