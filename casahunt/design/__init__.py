"""What an engineer decides with: diagrams, sensitivities, uncertainty, tuning, measured records.

    K_f(q): the fold gain of a servo with parameters q;    dK_f/dq = -nu . G_q;    K (1 + margin) > K_f for all q

diagram.py          the branch of a servo from a gain round the fold and back
sensitivity.py      the fold gain's derivatives by every parameter, from the adjoint
fold_curve.py       the fold gain against a second parameter
nearby.py           the fold of a servo near one whose fold is known
ensemble.py         the folds of thousands of servos in one call
fold_map.py         the fold gain over two parameters
uncertainty/        the fold gain of uncertain parameters: linear, sampled, worst corner
remedies/           what stops the hunting, how large, at what price
tune/               gain and controller times of least cost that do not hunt
record/             amplitude and frequency of a measured or simulated motion
identify/           friction from records
"""
