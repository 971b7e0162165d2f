"""The hull: Fossen's equation of motion term by term, ballast, tether, contact.

It may import `models.worlds`, `models.water` and what is below them. Start reading with
`vehicle.py`.
"""
