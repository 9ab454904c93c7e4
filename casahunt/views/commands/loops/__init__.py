"""What commands do with a loop of parts, where they do something else than with a servo.

shared.py      what they share: how a loop is called and written, its cycle by its branch, its border in a parameter
remedied.py    a servo with remedies by options, as a loop
fold_curve.py  a border in two parameters
"""
