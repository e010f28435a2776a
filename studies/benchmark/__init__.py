"""How fast the solver is against others, what its kernels reach of the memory, and what separations take."""
