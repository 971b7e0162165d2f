"""Navigation filters: strapdown mechanisation and aiding.

It may import `models.sensors` and what is below it. Start reading with `error_state_filter.py`.
"""
