"""The first tenant: a position servo with dry friction and integral action.

    J x2' = m - F(x2),    m = -(kp x1 + kd x2 + ki x3),    x1' = x2,    x3' = x1

friction.py       friction records and laws
controller.py     the controller in its two forms, by times and by gains
units.py          the units of its numbers
drive.py          the drive as built: sample time, delay, encoder, as a record
servo.py          the servo record; TOML in and out
gains.py          gains of the right size, and stability without dry friction, in closed form
outcome.py        what becomes of a motion: the words, and the record
parts/            controllers, frictions, loads and remedies, of which a loop is made
problem.py        the hunting servo as a problem for the engine; its orbits and folds
saved.py          hunting cycles and branches of them in files
denial.py         what proves that a servo has no cycle
event_map/        from one stick to the next: guesses, and evidence that no cycle exists
move.py           the move that a servo makes: a profile of its set point
trajectory.py     a motion as data: its events, what becomes of it
simulate.py       the motion from any initial state
sampled/          the loop as built: its motion, and quantisation told apart from stiction
linear/           the loop without dry friction: response, poles, margins, with delay or as built
refused.py        what is refused before any cycle is sought: no problem, times too far apart, proofs
cold_start.py     the cycles at one gain from motions or a scan, no branch followed
find_fold.py      from a servo to the largest gain at which it hunts
lopsided.py       the pairs of lopsided cycles that branch off from the symmetric one
find_orbit.py     from a servo to an orbit; where there is none, the fold that shows it
basin.py          how near to its set point a servo that stands still comes to rest
rest_states.py    the states at which a loop of parts can stand still for ever
equilibria.py     where the servo can stand still, and what linearising there proves
other_end.py      the cycle that a motion which rests has not come to
stable_up_to.py   in front of a fold: up to which value of the parameter its cycle is stable
"""
