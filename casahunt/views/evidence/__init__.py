"""The evidence of a tuning: every number of the page stands in the JSON object.

record.py   the JSON object
page.py     the page
"""
