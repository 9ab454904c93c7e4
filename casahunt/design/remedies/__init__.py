"""Which remedy stops the hunting, how large, at what price.

price.py       what it costs: errors at rest, a step simulated, motions from several starts
outcome.py     what a motion of a loop goes on to
border.py      the smallest size that ends it: where the branch of cycles in that size ends, or motions that hunt do
cures.py       a row of the table, and the table
remedies.py    the table of all remedies, and the sentence that names one
"""
