"""Templates: readable source that is appended to generated functions and compiled with them."""
