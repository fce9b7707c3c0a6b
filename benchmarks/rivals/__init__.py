"""MuJoCo's sysid and PySINDy on logs of the blind trials, given what flexid has to find."""
