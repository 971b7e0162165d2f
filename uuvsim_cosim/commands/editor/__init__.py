"""Commands for editors: `uuvsim lint`, and the workspace that `uuvsim new --workspace` writes."""
