"""Flight of a glider: a recording at sea, the prediction by the hull's coefficients, their fit."""
