"""The commands of `uuvsim`, one file each; heavy imports stand inside the functions."""
