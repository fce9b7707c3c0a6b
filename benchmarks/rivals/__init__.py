"""MuJoCo's sysid and PySINDy on logs of the blind trials, with terms and delays given."""
