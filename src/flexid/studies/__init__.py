"""Huang (2003) reproduced: Table I, the readings of its control law, and its claims."""
