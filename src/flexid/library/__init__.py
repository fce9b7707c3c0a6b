"""Public functions of flexid, one for each command, and the results that they return."""
