"""Reference problems, one file each: definition, source and reference values.

Tests, scripts and the README import them; they are not part of the installed package.
"""
