"""Many components become one simulation."""
