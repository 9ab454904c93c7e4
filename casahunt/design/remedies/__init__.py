"""Which remedy stops the hunting, how large, at what price.

sizes.py         what sizes are measured by, and what is more of one
scan.py          of motions from many starts, the worst
price.py         what it costs: errors at rest, a step simulated
handed_on.py     motions that hunt, handed on from size to size
border.py        the smallest size that ends it: where stable cycles in that size end, behind which no motion hunts
larger_sizes.py  whether more of it keeps hunting ended
cures.py         a row of the table, and the table
remedies.py      the table of all remedies, and the sentence that names one
"""
