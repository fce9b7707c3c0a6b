"""References and controllers, declared as text expressions with named parameters."""
