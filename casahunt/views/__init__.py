"""What a person sees: pictures, commands, pages.  Nothing here computes what it shows.

glossary.py   the words of the trade, each in a sentence
answers/      what the commands say: what it means first, and the mathematics behind it
pictures/     drawn by matplotlib, which only plotting.py imports
evidence/     a tuning, or the remedies, as one JSON object and one page
explore/      a page in the browser: the servo is turned, and answers
commands/     casahunt orbit, diagram, fold, ...: one module each
"""
