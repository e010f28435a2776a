"""IPOPT, by casadi."""
