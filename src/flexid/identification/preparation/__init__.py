"""What a user gives, made ready to be fitted."""
