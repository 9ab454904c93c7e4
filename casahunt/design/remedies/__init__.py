"""Which remedy stops the hunting, how large, at what price.

border.py      the smallest size that ends it: where the branch of cycles in that size ends
price.py       what it costs: errors at rest, a step simulated, motions from several starts
remedies.py    the table of all remedies, and the sentence that names one
"""
