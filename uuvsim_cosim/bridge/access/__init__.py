"""Authentication and authorisation: tokens, access files, passwords, certificates, roles.

It may import `bridge.calls`. Start reading with `authentication.py`.
"""
