"""What one component is: declarations in CasADi, in Fossen's notation."""
