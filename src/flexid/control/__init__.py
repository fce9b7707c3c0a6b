"""References and controllers, as declarations."""
