"""What a person sees: pictures, commands, the page of a tuning.  Nothing here computes what it shows.

pictures/     drawn by matplotlib, which only plotting.py imports
evidence/    a tuning as one JSON object and one page
commands/     casahunt orbit, diagram, fold, ...: one module each
"""
