"""A declaration becomes a file, a file becomes a component."""
