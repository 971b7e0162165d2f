"""Models against recordings of real vehicles: predictions of a fitted model beside simpler ones.

Start reading with `judge.py`.
"""
