"""Charts to terrain, and what is seen, heard and touched of it."""
