"""Reproduction of Huang (2003): Table I, the readings of its control law, and its claims."""
