"""What scripts/corpus.py asks, and how it compares two sets of answers.

servos.py     which servos are asked, at which gains, and what is known of them from outside
verbs.py      what is asked of a servo: here the names of the package's verbs stand
loops.py      loops of parts
gallery.py    the cycles and branches of problems/
questions.py  all of it, in groups that share a subject
kept.py       answers in files, line by line
compared.py   two sets of answers
truths.json   gains that are kept, and truths (scripts/peers/corpus_truths.py)
"""
