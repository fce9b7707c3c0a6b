"""Random planar arms, simulated by MuJoCo and identified by `flexid identify --model`."""
